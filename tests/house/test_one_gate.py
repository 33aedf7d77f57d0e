"""Effects pass one place each: files and folders made, moved and removed, processes, sockets, buses."""

import ast
import re
from pathlib import Path

import pytest

import swath

ROOT = Path(swath.__file__).parent
STREAMS = {"new_file", "open_to_write", "open_to_append", "BytesIO", "StringIO", "fdopen"}
WRITERS = {
    "savefig", "imsave", "savetxt", "savez", "savez_compressed", "print_png", "print_svg", "ParquetWriter",
    "write_bytes", "write_text", "copyfile", "copy", "copy2", "copytree", "move", "touch", "tofile",
    "NamedFile", "symlink_to", "hardlink_to", "mknod", "mkfifo", "symlink", "link", "truncate",
    "mkdir", "makedirs", "rename", "renames", "unlink", "rmdir", "removedirs", "rmtree",
}  # fmt: skip
OF_OS = {"link", "truncate", "remove"}  # others have methods of these names
OF_SHUTIL = {"copy", "move"}
NAMED = {
    "open",
    "ZipFile",
    "save",
    "write",
    "write_table",
    "replace",
    "remove",
}  # where what they get is a path
OWN_WRITES = {
    "core/apart/confine.py": {"open"},  # a folder that may be read, by its place
    "core/apart/serve.py": {"open"},  # os.devnull
    "core/files/place.py": {"mkdir", "open", "replace", "rmdir", "rmtree", "unlink"},  # here all others come
    "core/files/whole_file.py": {"NamedFile", "open", "replace", "unlink"},  # in a folder that `place` opened
    "core/files/read_file.py": {"open"},  # to read
    "core/files/temporary.py": {"open", "rmtree"},  # of folders that nobody else can write
    "kernels.py": {"mkdir", "open"},  # a cache that nobody else can write; os.devnull
    "link/device/wires.py": {"open", "symlink_to", "unlink"},  # a terminal; its link where the user named it
    "link/fmi/instance.py": {"mkdir"},  # in a temporary folder
    "commands/main.py": {"open"},  # os.devnull
    "commands/new.py": {"copytree"},  # of the examples, to a name that is free
    "runtime/folder.py": {"mkdir"},  # a new folder in `runs`, never one that is there
}
STARTERS = {"Popen", "Process", "ProcessPoolExecutor", "Pool", "get_context", "popen", "fork", "LocalCluster"}
OWN_STARTS = {  # each through `core/process/processes.py`
    "core/process/processes.py": {"Popen"},
    "runtime/workers.py": {"get_context", "Process"},
    "tools/function_test/cluster.py": {"LocalCluster"},
    "tools/function_test/plan.py": {"run"},  # git, which is no Python
}
LOOKED_AT = WRITERS | NAMED | STARTERS | {"run", "call", "check_call", "check_output"}


class Calls(ast.NodeVisitor):
    """Calls of a file that may have an effect, each with the names that stand for open files around it."""

    def __init__(self):
        self.found, self._streams = [], [set()]

    def visit_FunctionDef(self, node):
        given = {a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg) and a.annotation is not None}
        texts = {
            a.arg: ast.unparse(a) for a in ast.walk(node.args) if isinstance(a, ast.arg) and a.arg in given
        }
        self._streams.append(
            self._streams[-1] | {n for n, t in texts.items() if "BinaryIO" in t} | _opened(node)
        )
        self.generic_visit(node)
        self._streams.pop()

    def visit_Call(self, node):
        name = _name(node)
        if name in LOOKED_AT or name[:4] in ("exec", "spaw", "syst"):
            owner = ast.unparse(node.func).rpartition(".")[0]
            self.found.append((owner, name, node, self._streams[-1]))
        self.generic_visit(node)


def _name(call):
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def _opened(function):
    """Names that a function binds to what an opener gives."""
    found = set()
    for node in ast.walk(function):
        pairs = [(node.targets[0], node.value)] if isinstance(node, ast.Assign) else []
        pairs += [(i.optional_vars, i.context_expr) for i in getattr(node, "items", ()) if i.optional_vars]
        for target, value in pairs:
            if isinstance(value, ast.Call) and _name(value) in STREAMS:
                found.add(ast.unparse(target))
    return found


@pytest.fixture(scope="module")
def calls():
    found = []
    words = "|".join((WRITERS | STARTERS | {"open", "ZipFile", "write_table", "replace"}) - OF_SHUTIL)
    of_kind = r"(save|write)\(.*(format|do_compress|encoding)="
    may = re.compile(rf"({words})\(|shutil|subprocess|os\.(exec|re|sp|sy)|{of_kind}")
    for file in ROOT.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if may.search(text):
            visitor = Calls()
            visitor.visit(ast.parse(text))
            found += [(file.relative_to(ROOT).as_posix(), *call) for call in visitor.found]
    return found


def _writes(owner, name, node, streams):
    """Whether a call writes to a path."""
    target = ast.unparse(node.args[0]) if node.args else ""
    words = [*node.args, *(k.value for k in node.keywords if k.arg == "mode")]
    modes = {w.value for w in words if isinstance(w, ast.Constant) and isinstance(w.value, str)}
    to_write = any(set(m) <= set("rwxab+t") and set(m) & set("wxa+") for m in modes)
    if name == "replace":  # of a path takes one thing, of a text or a record more or keywords
        return owner == "os" or (len(node.args) == 1 and not node.keywords)
    if name in OF_OS:
        return owner == "os"
    if name in ("open", "ZipFile"):
        return (to_write and target not in streams) or owner == "os"
    if owner == "pq" and name == "write_table":
        return ast.unparse(node.args[1]) not in streams
    if name in WRITERS and (name not in OF_SHUTIL or owner == "shutil"):
        return target not in streams
    if name in ("save", "write"):  # of a picture, a point cloud: what says of what kind the file is
        return (
            any(k.arg in ("format", "do_compress", "encoding") for k in node.keywords)
            and target not in streams
        )
    return False


def test_no_writer_takes_a_path(calls):
    """What is written goes into what `core/files/whole_file.py` opened, or into memory."""
    found = {}
    for file, owner, name, node, streams in calls:
        if _writes(owner, name, node, streams):
            found.setdefault(file, set()).add(name)
    assert found == OWN_WRITES


def test_processes_are_started_in_one_place(calls):
    found = {}
    for file, owner, name, _, _ in calls:
        if (
            name in STARTERS
            or owner == "subprocess"
            or (owner == "os" and name[:4] in ("exec", "spaw", "syst"))
        ):
            found.setdefault(file, set()).add(name)
    assert found == OWN_STARTS


OWN_READS = {  # parts of swath itself, and what it wrote in the same command; all else: `read_file.py`
    "api.py", "commands/docs.py", "commands/main.py", "commands/new.py", "commands/scenarios.py",
    "commands/sheets.py", "core/files/read_file.py", "documents/packed.py", "field/cutting/height_kernel.py",
    "field/cutting/recount_kernel.py",
    "fleet/command.py", "fleet/ground_kernel.py", "judge/summary.py", "kernels.py", "link/fmi/export.py",
    "link/fmi/export_slave.py", "rays/packets/kernel.py", "rays/sight_kernel.py", "rays/single/kernel.py",
    "replay/writer.py", "report/html.py", "sensing/native/kernel.py", "sensing/native/normals_kernel.py",
    "sensing/native/dust_kernel.py", "sensing/native/receive_kernel.py",
    "tools/function_test/odd/openodd.py",
}  # fmt: skip
READERS = re.compile(
    r"\.read_(?:text|bytes)\(|np\.load\(|ParquetFile\(|pq\.read_table\(|(?<!def )(?<![\w.])open\("
    r"|imread\((?!io\.)"
    r"|(?<!os)(?<!gzip)(?<!device)(?<!memory)(?<!Image)(?<!rasterio)(?<!laspy)\.open\("  # of what was opened
)


def test_no_reader_takes_a_path():
    found = {
        file.relative_to(ROOT).as_posix()
        for file in ROOT.rglob("*.py")
        if READERS.search(file.read_text(encoding="utf-8"))
    }
    assert found == OWN_READS
