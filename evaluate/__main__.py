"""`uvcloth evaluate`: judge methods on simulated windows of unseen motion, and write the report.

In a checkout `python -m evaluate` is the same.
"""

import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import tyro

from uvcloth.commands.options import FOLDER, GARMENT, Jobs, Threads
from uvcloth.errors import InputError
from uvcloth.files.atomic import sole_writer
from uvcloth.files.options import AtLeast, Between, NewFolder, Several, parsed
from uvcloth.methods.registry import list_methods
from uvcloth.process.command import run_command


@dataclass(frozen=True)
class Evaluate:
    """Compare methods with simulated test windows; run it again to continue."""

    data: Annotated[Path, FOLDER]
    """A folder made by `uvcloth simulate`; its index.csv gives splits and actions. Each random
    outfit is evaluated on its own body, and figures are by type of garment."""
    out: Annotated[Path, NewFolder()]
    """Folder for metrics.json and report.html."""
    model: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="NAME|RUN ...",
            help=f"Methods: {list_methods()}; or folders written by `uvcloth train`. For layered outfits "
            "also one method per garment, the innermost first: RUN_A+RUN_B. NAME@dynamic and NAME@static add "
            "a finish of the cloth solver, physics@fast and NAME@dynamic@fine choose its cages.",
        ),
        Several(),
    ] = ()
    predicted: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="NAME=DIR[@FINISH] ...",
            help="Folders with the sequences of other programs: for DATA/CLIP_GARMENT.npz a file "
            "CLIP_GARMENT with the suffix .npz, .pc2, .mdd, .abc, .usd, .usda or .usdc. NAME=DIR@dynamic and "
            "@static add a finish of the cloth solver.",
        ),
        Several(),
    ] = ()
    garment: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE ..."), GARMENT, Several()] = ()
    """Garment files to evaluate as well; the data folder has to contain their sequences."""
    split: Literal["test", "validation"] = "test"
    """Windows to evaluate: test, or validation while settings are chosen."""
    actions: Annotated[tuple[str, ...], Several()] = ()
    """Evaluate only these actions."""
    frames: Annotated[int | None, tyro.conf.arg(metavar="N"), AtLeast(1)] = None
    """Evaluate only the first N frames of every window, after the warm-up."""
    map_size: Annotated[int, Between(1, 8192)] = 256
    """Size of the maps for the map MSE."""
    pictures: bool = True
    """Draw pictures of every action, of latent spaces of garments, and of training and test motion."""
    memory: bool = False
    """Measure the memory of each method too, in a process of its own (Linux; a few seconds each)."""
    blind: bool = False
    """Judge nothing, but write OUT/blind.html: pairs of clips without names, for people to compare."""
    jobs: Jobs = None
    """Number of methods to judge at the same time."""
    threads: Threads = 1
    """Number of CPU threads of each; on a loaded machine several are slower than one."""

    def run(self) -> None:
        """Judge, and write metrics.json and the report. Raises InputError for input that cannot be judged."""
        if not all(find_spec(module) for module in ("jinja2", "markupsafe", "PIL", "sklearn")):
            raise InputError("the report needs Jinja, Pillow and scikit-learn: install uvcloth[report]")
        if not self.model and not self.predicted:
            raise InputError("evaluate: name something to judge with --model or --predicted")
        with sole_writer(self.out):
            self._judge()

    def _judge(self) -> None:
        from uvcloth.process.threads import limited_threads

        from .beside import Request, judge_beside, load_comparison, processes
        from .blind import write_blind
        from .compare import compare
        from .garment_space import interpolations
        from .memory import rollout_memory
        from .motion_map import motion_maps
        from .records import Records
        from .report import write_metrics, write_report
        from .selection import Selection
        from .show import pictured, pictures, viewer_clips
        from .workers import workers

        selection = Selection(self.data, self.actions, self.garment, self.frames, self.split, self.map_size)
        request = Request(selection, self.model, self.predicted, self.threads)
        with limited_threads(self.threads):
            comparison = load_comparison(request)
            cases, candidates = comparison.cases, comparison.candidates
            if self.blind:
                print(write_blind(candidates, comparison.predictions, cases, self.out))
                return
            count = processes(comparison, self.jobs)
            used = f"{machine()}, threads used: {self.threads}"
            records = Records(self.out / "partial", used, cases.map_size)
            with workers(count) as work:
                if count > 1:
                    judge_beside(request, comparison, records, work)
                results, shown = compare(candidates, cases, records, comparison.predictions)
                memory = rollout_memory(candidates, cases) if self.memory else {}
                for name, by_outfit in memory.items():
                    results["methods"][name]["memory_mb"] = by_outfit
                metrics = write_metrics(self.out, results)
                images, spaces, motion = [], [], []
                if self.pictures:
                    images = pictures(pictured(shown), list(results["methods"]), work)
                    if cases.one_body:
                        spaces = interpolations(candidates, shown, cases.body)
                        motion = motion_maps(candidates, self.data, shown, cases.body)
        report = write_report(self.out, results, viewer_clips(shown), images, spaces, motion)
        print(summary(results))
        print(f"{metrics}\n{report}")


def machine() -> str:
    """The processor that the times were measured on, in words."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{platform.machine()}, {platform.system()}, {cores} cores, Python {platform.python_version()}"


def summary(results: dict) -> str:
    """Per garment or outfit and method, before and after the finish: the mean distance, and its ratio to the
    better LBS. Then a warning for each method that has used evaluated windows in training or selection, and
    one where all windows are of one person.
    """
    from .answers import one_person
    from .familiar import cautions
    from .standings import Rank, standings

    def format_rank(rank: Rank) -> str:
        beside = f"{100 * (rank.against - 1):+4.0f} %, {rank.won} of {rank.of}" if rank.against else ""
        return f"{rank.mean_mm:6.1f} mm {beside:18}"

    entries = standings(results)
    wide = max(8, *(len(row.garment) for row in entries))
    method = max(16, *(len(row.method) for row in entries))
    rows = [
        f"{row.garment:{wide}} {row.method:{method}} "
        f"{format_rank(row.before)} {format_rank(row.after)}".rstrip()
        for row in entries
    ]
    title = "mean vertex distance; against the better LBS, and on how many actions lower"
    warnings = [
        f"{caution.method} {caution.says} {'; '.join(caution.familiar)}"
        for caution in cautions(results)
        if caution.red
    ]
    warnings += filter(None, [one_person(results)])
    return "\n".join(
        [title, f"{'':{wide + method + 1}} {'before the finish':28} after the finish", *rows, *warnings]
    )


def parse(arguments: Sequence[str]) -> Evaluate:
    """Parse a command line. Raises as `uvcloth.cli.parse`."""
    return parsed(lambda: tyro.cli(Evaluate, args=arguments, prog="uvcloth evaluate"), arguments)


def run(words: Sequence[str]) -> None:
    """Parse a command line and judge. Raises as `parse` and `Evaluate.run`."""
    parse(words).run()


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and judge; returns the exit code: 0, 2 for bad input, 130 after Ctrl-C."""
    return run_command("evaluate", lambda: run(sys.argv[1:] if arguments is None else arguments))


if __name__ == "__main__":
    sys.exit(main())
