"""Mutated files for every reader: each ends in the documented error or in a value that passes its checks.

    python -m tests.fuzz                              10,000 cases of every reader, and a table (`make fuzz`)
    python -m tests.fuzz --only body clip --cases 500
    python -m tests.fuzz --replay body:17             one case again, with its traceback; its files are kept

To add a reader, write a `Target` (`tests/fuzz/target.py`) and put it into the list TARGETS of a module that
`tests/fuzz/registry.py` names:

    def good_mesh(folder: Path) -> Path:              # a small good file in an empty folder
        (folder / "a.obj").write_text(TRIANGLE)       # more files may lie beside it, all are mutated
        return folder / "a.obj"                       # what `read` takes; may be the folder itself

    def check_mesh(mesh: Mesh) -> None:               # what the reader promises of whatever it returns
        require(len(mesh.faces) == 0 or int(mesh.faces.max()) < len(mesh.vertices), "a face out of range")

    TARGETS = [Target("obj", good_mesh, read_obj, check_mesh)]

A file is mutated by the mutators of its suffix (`tests/fuzz/mutators.py`) and by those of the target; a
mutator is a function of a path and a `random.Random` that changes the file and says in words what it did. A
case is known by target, seed and number alone. `tests/fuzz/test_readers.py` runs the first of every target.
"""
