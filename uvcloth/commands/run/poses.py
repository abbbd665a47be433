"""Body poses to train on, drawn from motions."""

from uvcloth.bodies.body import load_body
from uvcloth.commands.poses import DrawPoses
from uvcloth.files.atomic import make_folder
from uvcloth.motion.clip_splits import find_sources
from uvcloth.motion.draw_poses import draw_poses
from uvcloth.motion.poses import SPLITS, save_poses
from uvcloth.motion.recombine import recombine
from uvcloth.physics.self_contact import SelfContact


def run(command: DrawPoses) -> None:
    """Draw the poses and write them. Raises InputError for bad input."""
    sources = find_sources(command.clips, command.windows, command.clips_from)
    make_folder(command.out.parent)
    body, seed = load_body(command.body), command.seed
    clear = SelfContact(body).clear
    poses = draw_poses(sources, body, clear, command.apart, command.mirror, seed, command.every)
    poses = recombine(poses, body, clear, command.recombine, seed)
    save_poses(poses, command.out)
    print(f"{command.out}: {', '.join(f'{len(poses.of(split))} {split}' for split in SPLITS)} poses")
