"""Layouts of motion files by the program that writes them."""

from tests.motion.layouts import Layout

MB_SIDES = "{S}UpLeg,{S}Leg,{S}Foot,{S}ToeBase,{S}Shoulder,{S}Arm,{S}ForeArm,{S}Hand,{S}HandIndex1"
MVN_SIDES = "{S}Hip,{S}Knee,{S}Ankle,{S}Toe,{S}Collar,{S}Shoulder,{S}Elbow,{S}Wrist,-"
VRM_SIDES = (
    "{side}UpperLeg,{side}LowerLeg,{side}Foot,{side}Toes,"
    "{side}Shoulder,{side}UpperArm,{side}LowerArm,{side}Hand,{side}MiddleProximal"
)
LAFAN_SIDES = "{S}UpLeg,{S}Leg,{S}Foot,{S}Toe,{S}Shoulder,{S}Arm,{S}ForeArm,{S}Hand,-"
BANDAI_SIDES = "UpperLeg_{L},LowerLeg_{L},Foot_{L},Toes_{L},Shoulder_{L},UpperArm_{L},LowerArm_{L},Hand_{L},-"
UNREAL_SIDES = (
    "thigh_{s},calf_{s},foot_{s},ball_{s},clavicle_{s},upperarm_{s},lowerarm_{s},hand_{s},middle_01_{s}"
)

FAMILIES: dict[str, Layout] = {
    "MotionBuilder": Layout("Hips,Spine,Spine1,Spine2,Neck,-,Head", MB_SIDES),
    "CMU": Layout("Hips,LowerBack,Spine,Spine1,Neck,Neck1,Head", MB_SIDES, unit=17.8),
    "Mixamo": Layout(
        "mixamorig:Hips,mixamorig:Spine,mixamorig:Spine1,mixamorig:Spine2,mixamorig:Neck,-,mixamorig:Head",
        ",".join(f"mixamorig:{name}" for name in MB_SIDES.split(",")),
        order="XYZ",
    ),
    "Mixamo, other prefix": Layout(
        "Paladin_Hips,Paladin_Spine,Paladin_Spine1,Paladin_Spine2,Paladin_Neck,-,Paladin_Head",
        ",".join(f"Paladin_{name}" for name in MB_SIDES.split(",")),
    ),
    "3ds Max": Layout("Hips,-,Chest,Chest2,Neck,-,Head", MVN_SIDES, order="ZXY"),
    "3ds Max Biped": Layout(
        "Bip01 Pelvis,Bip01 Spine,Bip01 Spine1,-,Bip01 Neck,-,Bip01 Head",
        "Bip01 {L} Thigh,Bip01 {L} Calf,Bip01 {L} Foot,Bip01 {L} Toe0,Bip01 {L} Clavicle,Bip01 {L} UpperArm,"
        "Bip01 {L} Forearm,Bip01 {L} Hand,Bip01 {L} Finger1",
        zero="body", up="z", order="ZXY", above=("Bip01",),
    ),
    "DAZ": Layout(
        "hip,abdomen,chest,-,neck,-,head",
        "{s}Thigh,{s}Shin,{s}Foot,{s}Toe,{s}Collar,{s}Shldr,{s}ForeArm,{s}Hand,{s}Mid1", order="YZX",
    ),
    "DAZ Genesis 8": Layout(
        "hip,abdomenLower,chestLower,chestUpper,neckLower,neckUpper,head",
        "{s}ThighBend,{s}Shin,{s}Foot,{s}Toe,{s}Collar,{s}ShldrBend,{s}ForearmBend,{s}Hand,{s}Mid1",
        zero="body", order="YZX",
    ),
    "Character Creator": Layout(
        "CC_Base_Hip,CC_Base_Waist,CC_Base_Spine01,CC_Base_Spine02,CC_Base_NeckTwist01,-,CC_Base_Head",
        "CC_Base_{L}_Thigh,CC_Base_{L}_Calf,CC_Base_{L}_Foot,CC_Base_{L}_ToeBase,CC_Base_{L}_Clavicle,"
        "CC_Base_{L}_Upperarm,CC_Base_{L}_Forearm,CC_Base_{L}_Hand,CC_Base_{L}_Mid1",
        above=("RL_BoneRoot",),
    ),
    "Rokoko": Layout(
        "Hips,Spine1,Spine2,Spine3,Neck,-,Head",
        "{S}Thigh,{S}Shin,{S}Foot,{S}Toe,{S}Shoulder,{S}Arm,{S}ForeArm,{S}Hand,-",
        zero="along_y", order="YXZ",
    ),
    "Rokoko, any zero pose": Layout(
        "Hips,Spine1,Spine2,Spine3,Neck,-,Head",
        "{S}Thigh,{S}Shin,{S}Foot,{S}Toe,{S}Shoulder,{S}Arm,{S}ForeArm,{S}Hand,-",
        zero="random",
    ),
    "MakeHuman of 2009": Layout(
        "Hips,Spine1,Spine2,Spine3,Neck,-,Head",
        "UpLeg_{L},LoLeg_{L},Foot_{L},Toe_{L},__Clavicle_{L},UpArm_{L},LoArm_{L},Hand_{L},Middle1_{L}",
        up="z", unit=10.0, order="XYZ",
    ),
    "Xsens MVN": Layout("Hips,Chest,Chest3,Chest4,Neck,-,Head", MVN_SIDES, order="YXZ"),
    "Xsens segments": Layout(
        "Pelvis,L5,T12,T8,Neck,-,Head",
        "{S}UpperLeg,{S}LowerLeg,{S}Foot,{S}Toe,{S}Shoulder,{S}UpperArm,{S}ForeArm,{S}Hand,-",
        up="z", unit=1.0,
    ),
    "LAFAN1": Layout("Hips,Spine,Spine1,Spine2,Neck,-,Head", LAFAN_SIDES, zero="along_x"),
    "Bandai-Namco": Layout(
        "Hips,Spine,Chest,-,Neck,-,Head", BANDAI_SIDES, zero="along_y", up="z", order="ZXY",
        above=("joint_Root",), channels="all",
    ),
    "Y-up rest, Z-up motion": Layout("Hips,Spine,Spine1,Spine2,Neck,-,Head", MB_SIDES, zero="lying", up="z"),
    "Blender Rigify": Layout(
        "spine,spine.001,spine.002,spine.003,spine.004,spine.005,spine.006",
        "thigh.{L},shin.{L},foot.{L},toe.{L},shoulder.{L},upper_arm.{L},forearm.{L},hand.{L},f_middle.01.{L}",
        zero="body", up="z", unit=1.0, order="XYZ",
    ),
    "VRM": Layout("hips,spine,chest,upperChest,neck,-,head", VRM_SIDES, unit=1.0),
    "VRoid": Layout(
        "J_Bip_C_Hips,J_Bip_C_Spine,J_Bip_C_Chest,J_Bip_C_UpperChest,J_Bip_C_Neck,-,J_Bip_C_Head",
        "J_Bip_{L}_UpperLeg,J_Bip_{L}_LowerLeg,J_Bip_{L}_Foot,J_Bip_{L}_ToeBase,J_Bip_{L}_Shoulder,"
        "J_Bip_{L}_UpperArm,J_Bip_{L}_LowerArm,J_Bip_{L}_Hand,J_Bip_{L}_Middle1",
        unit=1.0, order="ZXY",
    ),
    "Unreal": Layout(
        "pelvis,spine_01,spine_02,spine_03,neck_01,-,head", UNREAL_SIDES, zero="body", up="z",
        above=("root",),
    ),
    "MakeHuman": Layout(
        "root,spine05,spine03,spine01,neck01,neck02,head",
        "upperleg01.{L},lowerleg01.{L},foot.{L},toe1-1.{L},clavicle.{L},upperarm01.{L},lowerarm01.{L},wrist.{L},"
        "finger3-1.{L}",
        zero="body", up="z", unit=10.0,
    ),
    "SMPL": Layout(
        "Pelvis,Spine1,Spine2,Spine3,Neck,-,Head",
        "{L}_Hip,{L}_Knee,{L}_Ankle,{L}_Foot,{L}_Collar,{L}_Shoulder,{L}_Elbow,{L}_Wrist,-", unit=1.0,
    ),
}  # fmt: skip
"""Layout of each family: names and rest poses as its files have them, on our body."""
