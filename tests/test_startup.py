"""A quick start: what `import sagnac` and `sagnac --help` cost, and what they must not load."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import pytest

import sagnac

HEAVY = {"numba", "llvmlite", "scipy", "matplotlib", "pyarrow", "pint", "pydantic", "pandas", "tomlkit"}
CLI = "from sagnac.cli import main; main()"


def loaded_by(code: str) -> set[str]:
    tell = "import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{tell}"], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def cpu_seconds(*arguments: str) -> float:
    """Least CPU time of five runs in a child, user and system together."""
    best = float("inf")
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        best = min(best, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return best


def test_import_loads_nothing_heavy():
    assert not loaded_by("import sagnac") & (HEAVY | {"numpy", "typer"})


def test_the_command_line_loads_nothing_heavy():
    assert not loaded_by("import sagnac.cli") & HEAVY


@pytest.mark.parametrize("module", ["units", "plan", "recording", "calibration", "compensation", "sensors", "formats"])
def test_modules_load_no_compiler_no_plots_and_no_files_until_they_are_used(module):
    assert not loaded_by(f"import sagnac.{module}") & {"numba", "llvmlite", "scipy", "matplotlib", "pyarrow", "pint"}


# the two budgets that the design sets, in seconds of CPU
def test_import_budget():
    assert cpu_seconds("-c", "import sagnac") < 0.3


def test_help_budget():
    assert cpu_seconds("-c", f"import sys; sys.argv = ['sagnac', '--help']; {CLI}") < 0.4


@pytest.mark.parametrize("name", sagnac.__all__)
def test_names_of_the_package_are_there(name):
    assert getattr(sagnac, name) is not None
    assert name in dir(sagnac)


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="module 'sagnac' has no attribute 'nothing'"):
        _ = sagnac.nothing


def test_a_closed_pipe_is_no_crash():
    # as `sagnac --help | head -1` closes it
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-c", f"import sys; sys.argv = ['sagnac', '--help']; {CLI}"],
            stdout=write, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    finally:
        os.close(write)
    assert "Traceback" not in done.stderr
