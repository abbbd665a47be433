// Roles of joints: which is the left thigh, in the names of capture systems and engines, as uvcloth/motion/roles.py has them.

const MIDDLE_NAMES = {
  hips: "hips hip pelvis",
  lower_spine: "lowerback abdomen waist spine",
  middle_spine: "spine chest spine1",
  upper_spine: "spine1 chest2 spine2 upperchest",
  lower_neck: "lowerneck necklower neck neck01 necktwist01",
  upper_neck: "neck1 neckupper neck02 necktwist02 neck2 neck",
  head: "head",
};
const SIDE_NAMES = {
  thigh: "upleg upperleg hip thigh thighbend upperleg01",
  shin: "leg knee shin lowleg lowerleg calf lowerleg01",
  foot: "ankle foot",
  toes: "toebase toe toes toe0 ball toe31 toe11 foot",
  upper_arm: "arm upperarm uparm shldr shldrbend shoulder upperarm01",
  clavicle: "collar clavicle shoulder",
  forearm: "forearm elbow lowarm lowerarm forearmbend lowerarm01",
  hand: "wrist hand",
  fingers:
    "handindex1 handmiddle1 handfinger1 fingers mid1 middle1 middleproximal middle01 fmiddle01 index1 indexproximal index01 findex01 finger1 finger31",
};
const SPINE_NAME = /^(lowerback|(abdomen|waist|torso|spine|chest|upperchest)\d*(lower|upper)?\d*|[lt]\d+)$/;
const WORD = /[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+/g;
const SIDES = { left: "left", right: "right", l: "left", r: "right" };
const KNOWN_PREFIXES = ["mixamorig", "def", "org", "j", "bip", "c"];
const PREFIX_SHARE = 0.6;

/** The index of the joint that plays each role, by the joints' names. */
export function rolesOf(names) {
  const words = plainWords(names), whole = new Map(words.map((parts, joint) => [parts.join(""), joint]));
  const roles = {}, isTaken = (joint) => Object.values(roles).includes(joint);
  const take = (role, candidates) => {
    const joint = candidates.find((each) => each !== undefined && !isTaken(each));
    if (joint !== undefined) roles[role] = joint;
  };
  for (const [role, aliases] of Object.entries(MIDDLE_NAMES)) take(role, aliases.split(" ").map((name) => whole.get(name)));
  const spine = [...whole].filter(([name]) => SPINE_NAME.test(name)).map(([, joint]) => joint).sort((a, b) => a - b);
  if (spine.length >= 3)
    Object.assign(roles, { lower_spine: spine[0], middle_spine: spine[spine.length >> 1], upper_spine: spine.at(-1) });
  const { full, short } = sideNames(words);
  for (const side of ["left", "right"])
    for (const [part, aliases] of Object.entries(SIDE_NAMES))
      take(`${side}_${part}`, [full, short].flatMap((known) => aliases.split(" ").map((name) => known.get(`${side} ${name}`))));
  return roles;
}

/** Words of each name in lower case, without the prefixes that most names share. */
function plainWords(names) {
  let words = names.map((name) => (name.split(/[:|]/).at(-1).match(WORD) ?? [""]).map((word) => word.toLowerCase()));
  for (;;) {
    const count = new Map();
    for (const parts of words) if (parts.length > 1) count.set(parts[0], (count.get(parts[0]) ?? 0) + 1);
    const isPrefix = (word) =>
      count.has(word) && !(word in SIDES) && (KNOWN_PREFIXES.includes(word) || count.get(word) >= PREFIX_SHARE * names.length);
    if (![...count.keys()].some(isPrefix)) return words;
    words = words.map((parts) => (parts.length > 1 && isPrefix(parts[0]) ? parts.slice(1) : parts));
  }
}

/** Joints by side and remaining name: those with the side in full, and those with its letter. */
function sideNames(words) {
  const full = new Map(), short = new Map();
  words.forEach((parts, joint) => {
    const name = parts.join(""), place = parts.findIndex((word) => word in SIDES);
    const side = place >= 0 ? parts[place] : Object.keys(SIDES).find((begin) => name.startsWith(begin));
    if (!side) return;
    const rest = place >= 0 ? parts.filter((_, index) => index !== place).join("") : name.slice(side.length);
    (side.length > 1 ? full : short).set(`${SIDES[side]} ${rest}`, joint);
  });
  return { full, short };
}
