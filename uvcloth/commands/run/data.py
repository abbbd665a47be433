"""Lists of simulated sequences, and what is packed, unpacked and exported."""

from rich.console import Console

from uvcloth.commands.data import Data
from uvcloth.dataset.packed import pack_folder, unpack_folder
from uvcloth.simulation.overview import overview
from uvcloth.writers.benchmark import export_benchmark


def run(command: Data) -> None:
    """List, pack, unpack or export. Raises InputError for bad input."""
    folder = command.folder
    if command.pack:
        print(f"{command.pack}: {pack_folder(folder, command.pack, 1e-3 * command.error)} sequences packed")
    elif command.unpack:
        print(f"{command.unpack}: {unpack_folder(folder, command.unpack)} sequences unpacked")
    elif command.export:
        print(f"{command.export}: {export_benchmark(folder, command.export)} sequences written")
    else:
        Console().print(overview(folder), soft_wrap=True)
