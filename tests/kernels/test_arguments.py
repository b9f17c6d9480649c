"""What compiled functions take: few names, more of them as named tuples."""

import ast

from scenes import ROOT

MOST = 12
DECORATORS = {"kernel", "inlined", "spliced"}


def _compiled() -> dict[str, int]:
    """Arguments of every function that Numba compiles, by file and name."""
    found = {}
    for file in sorted((ROOT / "specklegen").glob("**/kernels/*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef) and any(ast.unparse(d) in DECORATORS for d in node.decorator_list):
                arguments = node.args
                assert arguments.vararg is None
                assert arguments.kwarg is None
                count = len(arguments.posonlyargs + arguments.args + arguments.kwonlyargs)
                found[f"{file.stem}.{node.name}"] = count
    return found


def test_kernels_take_at_most_twelve_names():
    compiled = _compiled()
    assert len(compiled) > 100
    assert {name: count for name, count in compiled.items() if count > MOST} == {}
