"""The ways in: `python -m nhpocp`, and public names that a type checker knows."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import nhpocp


def test_the_package_runs_as_a_module(tmp_path):
    def said(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", "nhpocp", *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        return done.returncode, done.stdout, done.stderr

    assert said("--help")[1].startswith("Usage: nhpocp ")
    code, _, errors = said("check", "absent.yaml")
    assert (code, "absent.yaml" in errors) == (2, True)


def test_a_misspelt_public_name_is_an_error_for_type_checkers():
    tree = ast.parse(Path(nhpocp.__file__).read_text(encoding="utf-8"))
    assert not any(isinstance(node, ast.FunctionDef) and node.name == "__getattr__" for node in tree.body)
    (listed,) = (
        node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    homes = {alias.asname: node.module for node in listed.body for alias in node.names}
    assert homes == {name: f"nhpocp.{home}" for name, home in nhpocp._HOMES.items()}
    for name in nhpocp.__all__:
        assert getattr(nhpocp, name) is not None
    with pytest.raises(AttributeError, match="Continuaton"):
        _ = nhpocp.Continuaton
