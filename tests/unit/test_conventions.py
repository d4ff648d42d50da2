"""What the project promises about its own files."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# A path of somebody's machine; addresses and `a/home/b` do not count.
MACHINE_PATH = re.compile(r"(?<![\w.~<>{}-])/(?:home|root|Users|work)/[\w.-]")


def tracked() -> list[Path]:
    """Every file that git tracks or would track."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True)
    except (OSError, subprocess.CalledProcessError) as problem:
        pytest.skip(f"not a git checkout, so its files cannot be listed: {problem}")
    return [path for name in done.stdout.split("\0") if name and (path := ROOT / name).is_file()]


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def unsafe(tree: ast.AST) -> list[str]:
    """What runs text as code or as a command, or reads objects that can."""
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                found += [f"{node.lineno}: import {n.name}" for n in names if "pickle" in n.name]
            case ast.ImportFrom(module=str(module)) if "pickle" in module:
                found.append(f"{node.lineno}: from {module} import")
            case ast.Call(func=function, keywords=keywords):
                name = ast.unparse(function)
                if name in {"eval", "exec", "os.system", "yaml.load"} or name.endswith(".eval"):
                    found.append(f"{node.lineno}: {name}(")
                if name.endswith(("read_pickle", "to_pickle")):
                    found.append(f"{node.lineno}: {name}(")
                for keyword in keywords:
                    if keyword.arg in {"shell", "allow_pickle"} and not (
                        isinstance(keyword.value, ast.Constant) and keyword.value.value is False
                    ):
                        found.append(f"{node.lineno}: {name}({keyword.arg}=...)")
    return found


def test_no_file_names_a_path_of_a_machine():
    found = []
    for path in tracked():
        data = path.read_bytes()
        if b"\0" in data:
            continue
        for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), start=1):
            if MACHINE_PATH.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}")
    assert not found


@pytest.mark.parametrize(
    "path", sources("src", "scripts"), ids=lambda p: p.relative_to(ROOT).as_posix()
)
def test_nothing_unsafe_is_called(path):
    assert not unsafe(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "code",
    [
        "import pickle",
        "from pickle import loads",
        "eval('1')",
        "run('x', shell=True)",
        "np.load(f, allow_pickle=True)",
        "yaml.load(f)",
        "pandas.read_pickle(f)",
    ],
)
def test_unsafe_code_is_recognised(code):
    assert unsafe(ast.parse(code))


def test_one_module_defines_the_array_type():
    own = [
        path.relative_to(ROOT).as_posix()
        for path in sources("src", "scripts")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Assign) and "Array" in map(ast.unparse, node.targets)
    ]
    assert own == ["src/velocal/arrays.py"]
