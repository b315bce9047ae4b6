"""``sagnac align transfer`` and ``sagnac align covariance`` as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from sagnac.align.result import load
from sagnac.cli import terminal
from sagnac.simulate.run import run as simulate
from sagnac.simulate.scenario import load as scenario
from sagnac.simulate.scenario import text


@pytest.fixture(scope="module")
def simulated(tmp_path_factory) -> Path:
    """Two minutes of the shipped scenario: master, recording, configuration, truth."""
    folder = tmp_path_factory.mktemp("simulated")
    short = text("transfer").replace('duration = "900 s"', 'duration = "120 s"')
    assert short != text("transfer")
    (folder / "short.toml").write_text(short)
    simulate(scenario(folder / "short.toml"), folder, seed=4)
    return folder


@pytest.fixture(autouse=True)
def _compiled(monkeypatch):
    monkeypatch.setattr(terminal, "announce_compilation", lambda method: None)


def inputs(folder: Path) -> list[str]:
    return [
        "--master",
        f"{folder}/master.parquet",
        "--slave",
        f"{folder}/recording.parquet",
        "--config",
        f"{folder}/config.toml",
    ]


def listed(folder: Path = Path()) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_an_alignment(run, simulated):
    outcome = run("align", "transfer", *inputs(simulated), "--out", "aligned")
    assert (outcome.status, outcome.err) == (0, "aligning recording.parquet: 120 s\n")
    assert listed() == ["aligned"]
    assert listed(Path("aligned")) == [
        "alignment.json",
        "estimates.png",
        "history.parquet",
        "innovations.png",
        "observability.png",
    ]
    found = load("aligned/alignment.json")
    truth = json.loads((simulated / "truth.json").read_text())["parameters"]
    for name, true in truth.items():
        if name in found.values():
            assert abs(found[name].value - true) < 4 * found[name].standard_uncertainty, name
    assert outcome.out.startswith(
        "Transfer alignment, method wander, matching velocity, short states, feedback correction\n"
    )
    assert outcome.out.endswith("  written to aligned\n")
    assert "not observed: " in outcome.out
    for picture in Path("aligned").glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_json_for_machines(run, simulated):
    outcome = run("align", "transfer", *inputs(simulated), "--out", "aligned", "--json")
    assert outcome.status == 0
    assert outcome.out == Path("aligned/alignment.json").read_text()


def test_names_units_and_csv(run, simulated):
    for file in ("master", "recording"):
        table = parquet.read_table(simulated / f"{file}.parquet").slice(0, 6000 if file == "recording" else 600)
        if file == "recording":
            table = table.rename_columns([n.partition(" [")[0].upper() for n in table.column_names])
        csv.write_csv(pa.table(table), f"{file}.csv")
    outcome = run(
        *("align", "transfer", "--master", "master.csv", "--slave", "recording.csv"),
        *("--config", simulated / "config.toml", "--out", "aligned"),
        *(
            "--map",
            ",".join(f"{n}={n.upper()}" for n in ["time", *(f"{s}_{a}" for s in ("accel", "gyro") for a in "xyz")]),
        ),
        *("--units", "time=s,accel=m/s^2,gyro=rad/s", "--json"),
    )
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["time"] == pytest.approx(59.9)


def test_a_prediction(run, simulated):
    outcome = run("align", "covariance", "--config", simulated / "config.toml")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith("Covariance analysis, method wander")
    assert "standard uncertainty over time" in outcome.out
    # the row of 60 s: mountings about x and y, then azimuth (methods.md: 0.1737, 0.1722 and 20.73 arcmin)
    row = next(line for line in outcome.out.splitlines()[20:] if line.split()[:1] == ["60.0"] and "20.7" in line)
    assert row.split()[-1].startswith("20.7")
    assert listed() == []


def test_a_prediction_to_files(run, simulated):
    outcome = run("align", "covariance", "--config", simulated / "config.toml", "--out", "predicted", "--json")
    assert outcome.status == 0
    assert listed(Path("predicted")) == ["alignment.json", "estimates.png", "history.parquet", "observability.png"]
    assert outcome.out == Path("predicted/alignment.json").read_text()
    assert all(p["value"] is None for p in json.loads(outcome.out)["parameters"])


@pytest.mark.parametrize("command", ["transfer", "covariance"])
def test_help_has_an_example(run, command):
    outcome = run("align", command, "--help")
    assert outcome.status == 0
    assert f"sagnac align {command} --" in " ".join(outcome.out.split())


def test_align_lists_its_commands(run):
    outcome = run("align", "--help")
    assert outcome.status == 0
    assert all(name in outcome.out for name in ("static", "transfer", "covariance"))


# ------------------------------------------------------------------------------------------------- exit statuses


def test_data_that_do_not_support_the_result(run, simulated):
    table = parquet.read_table(simulated / "recording.parquet")
    for axis in "xyz":
        name = f"accel_{axis} [m/s^2]"
        table = table.set_column(table.column_names.index(name), name, [-table[name].to_numpy()])
    parquet.write_table(table, "upside.parquet")
    arguments = inputs(simulated)
    arguments[3] = "upside.parquet"
    outcome = run("align", "transfer", *arguments, "--out", "aligned")
    assert outcome.status == 1
    assert outcome.out == ""
    assert "the accelerometers have the other sign: at rest an upward axis must read +g" in outcome.err
    assert listed() == ["upside.parquet"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({1: "nowhere.parquet"}, "nowhere.parquet: cannot read"),
        ({3: "nowhere.parquet"}, "nowhere.parquet: cannot read"),
        ({5: "nowhere.toml"}, "nowhere.toml: cannot read the configuration"),
        ({1: "config"}, "config.toml: "),
        ({5: "wrong"}, 'gate: write a probability below 1, for example 0.9999, or "off"; got 3'),
    ],
)
def test_bad_input(run, simulated, change, says):
    arguments = inputs(simulated)
    Path("wrong.toml").write_text(f"gate = 3\n{(simulated / 'config.toml').read_text()}")
    names = {"config": str(simulated / "config.toml"), "wrong": "wrong.toml"}
    for i, value in change.items():
        arguments[i] = names.get(value, value)
    outcome = run("align", "transfer", *arguments, "--out", "aligned")
    assert outcome.status == 2
    assert outcome.err.startswith("sagnac: ")
    assert says in outcome.err
    assert listed() == ["wrong.toml"]


def test_options_that_are_missing_or_wrong(run, simulated):
    assert run("align", "transfer", *inputs(simulated)).status == 2
    assert run("align", "covariance").status == 2
    outcome = run("align", "transfer", *inputs(simulated), "--out", "aligned", "--units", "accel")
    assert outcome.status == 2
    assert "--units 'accel': write name=value pairs" in outcome.err
    assert listed() == []


def test_inputs_are_not_written_over(run, simulated):
    Path("history.parquet").write_bytes((simulated / "master.parquet").read_bytes())
    arguments = inputs(simulated)
    arguments[1] = "history.parquet"
    outcome = run("align", "transfer", *arguments, "--out", ".")
    assert outcome.status == 2
    assert "history.parquet: is an input; inputs are never modified" in outcome.err
    assert Path("history.parquet").read_bytes() == (simulated / "master.parquet").read_bytes()


def test_a_prediction_needs_a_course(run, simulated):
    text = (simulated / "config.toml").read_text()
    Path("c.toml").write_text(text[: text.index("[trajectory]")])
    outcome = run("align", "covariance", "--config", "c.toml")
    assert outcome.status == 2
    assert "[trajectory] is missing" in outcome.err
