"""Nothing in the code holds on Linux alone: encodings, paths, process starts, signals, system calls."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted(
    path
    for package in ("rasterize", "uvcloth", "train", "evaluate")
    for path in (ROOT / package).rglob("*.py")
)

TEXT_METHODS = {"read_text": 0, "write_text": 1}
"""Methods that take an encoding, and how many arguments come before it."""

PLACES = ("/tmp", "/dev", "/proc", "/sys", "/etc", "/home", "/usr", "/var")
"""Beginnings of paths that other systems do not have."""

LINUX_MODULES = {"fcntl", "grp", "pwd", "resource", "termios", "tty"}

LINUX_NAMES = {
    "os": {
        *("fork", "geteuid", "getpgid", "getuid", "killpg", "mkfifo", "posix_fallocate", "sched_getaffinity"),
        *("setsid", "statvfs", "uname", "wait", "waitpid"),
    },
    "signal": {"SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2"},
}
"""What Windows lacks of modules that it has; it may be used beside `hasattr(module, "name")`."""

START_METHODS = {"get_context", "set_start_method"}
"""Functions that choose how processes begin: by "spawn", the only way that every system has."""


def is_text(call: ast.Call, mode: int) -> bool:
    """Whether a call of an `open` reads or writes text; mode: the place of that argument."""
    given = next((word.value for word in call.keywords if word.arg == "mode"), None)
    if given is None and len(call.args) > mode:
        given = call.args[mode]
    return given is None or not (isinstance(given, ast.Constant) and "b" in str(given.value))


def without_encoding(call: ast.Call) -> bool:
    """Whether a call leaves the encoding of text to the system."""
    if any(word.arg == "encoding" for word in call.keywords):
        return False
    function = call.func
    if isinstance(function, ast.Name):
        return function.id == "open" and is_text(call, 1)
    if not isinstance(function, ast.Attribute):
        return False
    if function.attr in TEXT_METHODS:
        return len(call.args) <= TEXT_METHODS[function.attr]
    owner = function.value.id if isinstance(function.value, ast.Name) else ""
    if owner == "subprocess":
        return any(word.arg in ("text", "universal_newlines") for word in call.keywords)
    # Files of other libraries are opened with arguments of their own: Path.open has a mode or none.
    mode = call.args[0].value if call.args and isinstance(call.args[0], ast.Constant) else None
    plain = not call.args or (isinstance(mode, str) and set(mode) <= set("rwax+bt"))
    return function.attr == "open" and plain and is_text(call, 0)


def faults_of_call(call: ast.Call) -> Iterator[str]:
    """What in a call does not hold on every system."""
    if without_encoding(call):
        yield "text without an encoding"
    match call.func:
        case ast.Attribute(attr="rename"):
            yield "rename, which Windows refuses over a file; replace does it"
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in START_METHODS:
            if not (call.args and isinstance(call.args[0], ast.Constant) and call.args[0].value == "spawn"):
                yield "processes that do not start by spawn"
        case ast.Name(id="ProcessPoolExecutor" | "Pool"):
            if not any(word.arg == "mp_context" for word in call.keywords):
                yield "processes that start as the system likes"


def on_every_system(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a tree but for those below a question for `sys.platform`."""
    yield tree
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and "sys.platform" in ast.unparse(node.test)):
            yield from on_every_system(node)


def faults(source: str) -> Iterator[str]:
    """What in a module does not hold on every system, in words."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    sentences = {
        id(node.body[0].value)
        for node in nodes
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    asked = {
        (call.args[0].id, call.args[1].value)
        for call in nodes
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "hasattr"
        if isinstance(call.args[0], ast.Name) and isinstance(call.args[1], ast.Constant)
    }
    for node in on_every_system(tree) if "sys.platform" in source else nodes:
        match node:
            case ast.Call():
                yield from (f"line {node.lineno}: {fault}" for fault in faults_of_call(node))
            case ast.Import(names=names) if found := {name.name for name in names} & LINUX_MODULES:
                yield f"line {node.lineno}: module {found.pop()}"
            case ast.ImportFrom(module=str(module)) if module in LINUX_MODULES or module == "locale":
                yield f"line {node.lineno}: module {module}"
            case ast.Attribute(value=ast.Name(id=module), attr=name) if name in LINUX_NAMES.get(module, ()):
                if (module, name) not in asked:
                    yield f"line {node.lineno}: {module}.{name} without asking hasattr"
            case ast.Constant(value=str(text)) if id(node) not in sentences:
                if text.startswith(tuple(f"{place}/" for place in PLACES)) or text in PLACES:
                    yield f"line {node.lineno}: path {text}"


def test_nothing_holds_on_linux_alone() -> None:
    found = {path: list(faults(path.read_text(encoding="utf-8"))) for path in FILES}
    assert {path: words for path, words in found.items() if words} == {}


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("open('a')", "without an encoding"),
        ("open('a', 'w')", "without an encoding"),
        ("path.open('a')", "without an encoding"),
        ("path.open(newline='')", "without an encoding"),
        ("path.read_text()", "without an encoding"),
        ("path.write_text(text)", "without an encoding"),
        ("subprocess.run(command, text=True)", "without an encoding"),
        ("os.rename(a, b)", "rename"),
        ("os.fork()", r"os\.fork"),
        ("signal.signal(signal.SIGHUP, stop)", "SIGHUP"),
        ("import fcntl", "fcntl"),
        ("multiprocessing.get_context()", "spawn"),
        ("get_context('fork')", "spawn"),
        ("ProcessPoolExecutor(4)", "as the system likes"),
        ("folder = '/tmp/x'", "path /tmp/x"),
    ],
)
def test_what_holds_on_linux_alone_is_found(source: str, words: str) -> None:
    (fault,) = faults(source)
    assert words.replace("\\", "") in fault


@pytest.mark.parametrize(
    "source",
    [
        "open('a', 'rb')",
        "path.open('wb')",
        "av.open(str(path), 'w', format='gif')",
        "OpenImageIO.ImageInput.open(str(path))",
        "path.open('w', newline='', encoding='utf-8')",
        "path.read_text('utf-8')",
        "path.write_text(text, 'utf-8')",
        "if hasattr(os, 'sched_getaffinity'):\n    os.sched_getaffinity(0)",
        "get_context('spawn')",
        "if sys.platform != 'win32':\n    import fcntl",
        '"""A folder such as /tmp/x."""',
    ],
)
def test_what_holds_everywhere_is_left_alone(source: str) -> None:
    assert list(faults(source)) == []
