"""Campaigns from TOML: grids over scenarios, fleets, and what is told when they are wrong."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from campaign_tables import SMALL, norm

from sagnac.campaign import grid, spec
from sagnac.errors import InputError
from sagnac.simulate import scenario as scenarios

SETTING, NOISE = "rig.errors.setting", "unit.noise.accel"


def refused(table, **more):
    with pytest.raises(InputError) as told:
        spec.from_table(table, "C.toml", **more)
    return str(told.value)


def test_a_grid_is_every_combination_with_so_many_runs_each():
    axes = {
        SETTING: ["normal 1 arcmin", "normal 2 arcmin"],
        NOISE: ["10 ug/sqrt(Hz)", "20 ug/sqrt(Hz)", "30 ug/sqrt(Hz)"],
    }
    found = spec.from_table(norm(grid=axes, runs=5))
    assert found.index_count == 30
    assert found.keys == (SETTING, NOISE)
    assert found.points[1].values == {SETTING: "normal 1 arcmin", NOISE: "20 ug/sqrt(Hz)"}
    assert [found.point(i) for i in (0, 4, 5, 29)] == [(0, 0), (0, 4), (1, 0), (5, 4)]
    noise = spec.scenario(found.points[5]).unit.noise.accel
    assert noise == pytest.approx(30e-6 * 9.80665)


def test_nested_tables_are_dotted_keys():
    nested = norm(grid={"rig": {"errors": {"setting": ["normal 1 arcmin", "normal 2 arcmin"]}}})
    assert spec.from_table(nested) == spec.from_table(norm(grid={SETTING: ["normal 1 arcmin", "normal 2 arcmin"]}))


def test_chosen_points_are_run_as_they_stand():
    found = spec.from_table(norm(point=[{"method": "norm"}, {"method": "multi-position", "matrix": "triangular"}]))
    assert [p.options.method for p in found.points] == ["norm", "multi-position"]
    assert found.points[1].table["method"] == "norm"  # the truth of triangular matrices is in the triad's own frame
    assert spec.from_table(norm(method="multi-position")).points[0].table["method"] == "multi-position"


def test_without_a_grid_there_is_one_point_of_the_scenarios_own_method():
    found = spec.from_table({"scenario": "four-position", "runs": 7})
    assert (len(found.points), found.index_count, found.points[0].options.method) == (1, 7, "four-position")


def test_keys_reach_names_with_dots_and_entries_of_lists():
    table = {"unit": {"parameters": {"accel.bias.x": "1 mg"}}, "trajectory": {"leg": [{"duration": "1 s"}, {}]}}
    made = grid.replaced(table, {"unit.parameters.accel.bias.x": "2 mg", "trajectory.leg.2.duration": "9 s", "a.b": 1})
    assert made["unit"]["parameters"] == {"accel.bias.x": "2 mg"}
    assert made["trajectory"]["leg"] == [{"duration": "1 s"}, {"duration": "9 s"}]
    assert made["a"] == {"b": 1}
    assert table["unit"]["parameters"]["accel.bias.x"] == "1 mg"
    for key in ("trajectory.leg.0.duration", "trajectory.leg.3.duration", "trajectory.leg.x"):
        with pytest.raises(ValueError, match="none of the 2 entries"):
            grid.replaced(table, {key: 1})


@pytest.mark.parametrize(
    ("values", "numbers"),
    [
        ([1, 2.5], ([1.0, 2.5], "")),
        (["1 arcmin", "30 arcsec"], ([1.0, 0.5], "arcmin")),
        (["uniform 1 arcmin", "uniform 2 arcmin"], ([1.0, 2.0], "uniform arcmin")),
        (["uniform 1 arcmin", "normal 2 arcmin"], None),
        (["1 arcmin", "2 s"], None),
        (["norm", "table"], None),
        ([["1 s"], ["2 s"]], None),
        ([True, False], None),
    ],
)
def test_values_of_one_kind_are_numbers(values, numbers):
    found = grid.numbers(values)
    assert (found is None) == (numbers is None)
    if numbers is not None:
        assert found[0] == pytest.approx(numbers[0], rel=1e-12)
        assert found[1] == numbers[1]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"run": 3, "seed": -1}, ["run: no such key", "seed:"]),
        ({"runs": 0}, ["runs:"]),
        ({"recordings": "a.csv"}, ["scenario, recordings: give one of them"]),
        ({"plan": "a.toml"}, ["plan: belongs to a fleet"]),
        ({"grid": {NOISE: "10 ug/sqrt(Hz)"}}, [NOISE, "write a list"]),
        ({"grid": {NOISE: []}}, [NOISE, "write a list"]),
        ({"grid": {NOISE: ["1 ug/sqrt(Hz)", "1 ug/sqrt(Hz)"], "a": 3}}, [NOISE, "stands twice", "a: write a list"]),
        ({"grid": {NOISE: ["1 ug/sqrt(Hz)"]}, "point": [{NOISE: "1 ug/sqrt(Hz)"}]}, ["grid, point: give one of them"]),
        ({"grid": {"unit.noise.acel": ["1 ug/sqrt(Hz)"]}}, ["unit.noise.acel: no such key"]),
        ({"grid": {NOISE: ["1 ug/sqrt(Hz)", "1 m"]}}, ["grid: unit.noise.accel = 1 m", "has m where"]),
        ({"grid": {NOISE: ["1 m"], SETTING: ["2 s"]}}, ["1 m", "2 s"]),
        ({"grid": {"title.x": [1]}}, ["'title' is a value of the scenario"]),
        ({"grid": {"method": ["norm", "centrifuge"]}}, ["method = centrifuge", "not for a turntable"]),
        ({"grid": {"method": ["nrm"]}}, ["method: Input should be"]),
        ({"set": {**SMALL, "plan.dwell": "0 s"}}, ["plan: give dwell, turning or both"]),
        ({"set": {"title.x": 1}}, ["set: title.x"]),
        ({"threshold": 0.5}, ["threshold:"]),
    ],
)
def test_what_is_wrong_is_told_with_its_key(more, said):
    told = refused(norm(**more))
    assert told.startswith("C.toml: ")
    for part in said:
        assert part in told


def test_a_scenario_without_a_method_needs_one(tmp_path):
    (tmp_path / "bare.toml").write_text(scenarios.text("norm").replace('method = "norm"\n', ""))
    assert "method: is missing" in refused({"scenario": "bare.toml"}, folder=tmp_path)
    assert "there is no scenario nrom" in refused({"scenario": "nrom"})
    assert "cannot read the scenario" in refused({"scenario": "none.toml"}, folder=tmp_path)


def test_a_grid_too_large_is_refused():
    axes = {f"unit.parameters.accel.bias.{a}": list(range(30)) for a in "xyz"}
    assert "27000 points are more than" in refused(norm(grid=axes))


def test_the_identity_follows_what_results_depend_on(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(scenarios.text("norm"))
    table = {"scenario": "mine.toml", "runs": 3}

    def identity(**more):
        return spec.from_table(table | more, folder=tmp_path).identity

    first = identity()
    assert identity(title="another name") == first
    assert identity() == spec.from_table({"scenario": "norm", "runs": 3}).identity  # the content counts, not the name
    for more in (
        {"seed": 2},
        {"runs": 4},
        {"robust": True},
        {"set": {"plan.dwell": "299 s"}},
        {"parameters": ["accel"]},
    ):
        assert identity(**more) != first
    file.write_text(scenarios.text("norm").replace('"300 s"', '"301 s"'))
    assert identity() != first
    assert all(isinstance(v, str) for v in first.values())
    assert json.loads(first["campaign.runs"]) == 3


@pytest.fixture
def logs(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    for name in ("b", "a"):
        (folder / f"{name}.csv").write_text("time [s],accel_x [g]\n")
        (folder / f"{name}.toml").write_text('latitude = "45 deg"\n')
    return tmp_path


def test_a_fleet_is_its_recordings_in_order_with_their_plans(logs):
    found = spec.from_table({"recordings": "logs/*.csv", "plan": "logs/{stem}.toml", "method": "norm"}, folder=logs)
    assert [p.name for p in found.recordings] == ["a.csv", "b.csv"]
    assert [p.name for p in found.plans] == ["a.toml", "b.toml"]
    assert (found.index_count, found.point(1), found.is_fleet) == (2, (0, 1), True)
    shared = spec.from_table(
        {"recordings": ["logs/b.csv", "logs/*.csv"], "plan": "logs/a.toml", "method": "norm"}, folder=logs
    )
    assert [p.name for p in shared.recordings] == ["a.csv", "b.csv"]
    assert {p.name for p in shared.plans} == {"a.toml"}
    before = shared.identity
    (logs / "logs" / "a.toml").write_text('latitude = "46 deg"\n')
    assert shared.identity == before  # of one reading
    again = spec.from_table(
        {"recordings": ["logs/b.csv", "logs/*.csv"], "plan": "logs/a.toml", "method": "norm"}, folder=logs
    )
    assert again.identity != before


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"recordings": "logs/*.csv"}, "method: is missing"),
        ({"recordings": "logs/*.csv", "method": "transfer"}, "not for a fleet"),
        ({"recordings": "logs/*.csv", "method": "norm", "runs": 3}, "runs: belongs to a simulation"),
        ({"recordings": "logs/*.bin", "method": "norm"}, "no file matches 'logs/*.bin'"),
        ({"recordings": "logs/*", "method": "norm"}, "several files are called 'a'"),
        ({"recordings": "logs/*.csv", "method": "norm", "plan": "{stem}.toml"}, "plan: there is no"),
        ({"recordings": "logs/*.csv", "method": "norm", "plan": "logs/a.csv"}, "a.csv"),
    ],
)
def test_a_fleet_that_cannot_be_is_refused(logs, table, said):
    assert said in refused(table, folder=logs)


def test_the_examples_of_the_documentation_can_be_run(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "campaign.md").read_text(encoding="utf-8")
    blocks = dict(re.findall(r"```toml\n# (\S+)\n(.*?)```", page, flags=re.DOTALL))
    assert set(blocks) == {"dwell.toml", "table-angles.toml", "fleet.toml", "unit.toml"}
    for name, text in blocks.items():
        (tmp_path / name).write_text(text)
    assert spec.load(tmp_path / "dwell.toml").index_count == 750
    assert [p.options.method for p in spec.load(tmp_path / "table-angles.toml").points] == ["norm", "multi-position"]
    (tmp_path / "logs").mkdir()
    scenario = scenarios.load(tmp_path / "unit.toml")
    for i in (1, 2):
        (tmp_path / "logs" / f"U{i}.parquet").write_bytes(b"")
        scenario.plan.save(tmp_path / "logs" / f"U{i}.toml")
    assert spec.load(tmp_path / "fleet.toml").index_count == 2


def test_a_fleet_is_the_same_wherever_it_is_looked_at_from(logs, monkeypatch):
    table = {"recordings": ["../logs/*.csv"], "plan": "../logs/./{stem}.toml", "method": "norm"}
    (logs / "here").mkdir()
    whole = spec.from_table(table, folder=logs / "here")
    assert list(whole.digests) == ["../logs/a.csv", "../logs/a.toml", "../logs/b.csv", "../logs/b.toml"]
    assert all(p.is_absolute() and ".." not in p.parts for p in whole.inputs)
    monkeypatch.chdir(logs / "logs")
    again = spec.from_table(table, folder="../here")
    assert again.identity == whole.identity
    assert again.recordings == whole.recordings


def test_where_serial_numbers_are_from_is_part_of_what_a_fleet_is(logs):
    one = {"recordings": "logs/a.csv", "method": "norm"}
    shared = spec.from_table({**one, "plan": "logs/a.toml"}, folder=logs)
    own = spec.from_table({**one, "plan": "logs/{stem}.toml"}, folder=logs)
    assert shared.digests == own.digests
    assert shared.identity != own.identity


def test_the_same_recording_under_two_names(logs):
    found = spec.from_table({"recordings": "logs/*.csv", "plan": "logs/a.toml", "method": "norm"}, folder=logs)
    assert found.doubles == (("logs/a.csv", "logs/b.csv"),)


@pytest.mark.parametrize("more", [{"grid": {}}, {"point": []}])
def test_an_empty_grid_is_refused(more):
    assert f"{next(iter(more))}: is empty" in refused(norm(**more))
