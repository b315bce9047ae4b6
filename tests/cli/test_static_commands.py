"""``sagnac align static`` and ``sagnac navigate`` as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from sagnac.align.result import load
from sagnac.earth import earth_rate_enu, normal_gravity
from sagnac.frames import attitude_matrix
from sagnac.navigate.free import COLUMNS

DEGREE = np.pi / 180
PLACE = (34.25 * DEGREE, 380.0)
AT = ("--latitude", "34.25 deg", "--longitude", "108.9 deg", "--height", "380 m")
GYRO, ACCEL = 0.1 * DEGREE / 3600, 1.0 / 8000  # a pulse, rad and m/s
SCALE = ("--scale", "gyro=10 pulse/arcsec", "--scale", "accel=8000 pulse/(m/s)")


@pytest.fixture(scope="session")
def parked(tmp_path_factory):
    """Pulses of a unit at rest: heading 40 deg, pitch 1 deg, roll -2 deg, 80 s at 50 Hz, some noise."""
    rng = np.random.default_rng(1)
    n = 4000
    C = attitude_matrix(40 * DEGREE, 1 * DEGREE, -2 * DEGREE)
    turns = C.T @ earth_rate_enu(PLACE[0]) * 0.02 + 1e-8 * rng.normal(size=(n, 3))
    pushes = C.T @ [0, 0, normal_gravity(*PLACE)] * 0.02 + 2e-5 * rng.normal(size=(n, 3))
    counts = [
        np.diff(np.floor(np.cumsum(v, axis=0) / size), axis=0, prepend=0)
        for v, size in ((turns, GYRO), (pushes, ACCEL))
    ]
    columns = {"time [s]": np.round(0.02 * np.arange(1, n + 1), 6)}
    for sensor, values in zip(("gyro", "accel"), counts, strict=True):
        columns |= {f"{sensor}_{a} [pulse]": values[:, i].astype(np.int32) for i, a in enumerate("xyz")}
    path = tmp_path_factory.mktemp("parked") / "parked.parquet"
    parquet.write_table(pa.table(columns), path)
    return path


@pytest.fixture(scope="session")
def aligned(parked, tmp_path_factory):
    """An alignment over its first minute, made once."""
    from sagnac.align.static import align, place_of
    from sagnac.recording import open_recording

    recording = open_recording(parked, scale={"gyro": "10 pulse/arcsec", "accel": "8000 pulse/(m/s)"})
    out = tmp_path_factory.mktemp("aligned") / "alignment.json"
    align(recording, place_of(PLACE[0], 108.9 * DEGREE, 380.0), stop=60.0).save(out)
    return out


def listed() -> list[str]:
    return sorted(p.name for p in Path().iterdir())


def test_align_static_writes_and_prints_the_same(run, parked, aligned):
    outcome = run("align", "static", parked, *SCALE, *AT, "--to", "60 s", "--out", "alignment.json", "--json")
    assert outcome.status == 0
    found = load("alignment.json")
    assert json.loads(outcome.out) == json.loads(Path("alignment.json").read_text(encoding="utf-8"))
    assert found.model_dump(exclude={"created"}) == load(aligned).model_dump(exclude={"created"})
    assert (found.kind, found.time) == ("static", 60.0)
    for name, truth in (("heading", 40), ("pitch", 1), ("roll", -2)):
        assert abs(found[name].value - truth * DEGREE) < 4 * found[name].standard_uncertainty
    assert listed() == ["alignment.json"]


def test_align_static_prints_a_page(run, parked):
    outcome = run("align", "static", parked, *SCALE, *AT, "--gyro-bias", "0.02 deg/h", "--accel-bias", "100 ug")
    assert outcome.status == 0
    assert "Static alignment" in outcome.out
    assert "taken to be" not in outcome.out
    assert not listed()


def test_gyrocompass_by_option(run, parked):
    options = ("--method", "gyrocompass", "--gyro-noise", "0.001 deg/sqrt(h)", "--accel-noise", "10 ug/sqrt(Hz)")
    outcome = run("align", "static", parked, *SCALE, *AT, *options)
    assert outcome.status == 0
    assert "method gyrocompass" in outcome.out


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        (("--latitude", "-34.25 deg", *AT[2:]), 1, "latitude has the wrong sign"),
        (("--latitude", "34.25", *AT[2:]), 2, "--latitude: '34.25' has no unit"),
        (("--latitude", "100 deg", *AT[2:]), 2, "from -90 deg to 90 deg"),
        ((*AT, "--gyro-bias", "50 ug"), 2, "--gyro-bias"),
        ((*AT, "--gyro-noise", "0.001 deg/h"), 2, "--gyro-noise"),
        ((*AT, "--from", "100 s"), 1, "no samples from 100 s on"),
        ((*AT, "--from", "50 s", "--to", "20 s"), 2, "no stretch of time"),
        ((*AT, "--gyro-bias", "30 deg/h"), 1, "heading cannot be found"),
        ((*AT, "--gravity", "9.9 m/s^2"), 1, "accel biases of"),
        ((*AT, "--scale", "accel=816 pulse/(m/s)"), 1, "look like m/s^2 labelled g"),
    ],
)
def test_align_static_says_what_is_wrong(run, parked, options, status, words):
    outcome = run("align", "static", parked, *SCALE, *options, "--out", "alignment.json")
    assert outcome.status == status
    assert words in outcome.err
    assert not listed()


def test_align_static_keeps_its_input(run, parked):
    outcome = run("align", "static", parked, *SCALE, *AT, "--out", parked)
    assert outcome.status == 2
    assert "inputs are never modified" in outcome.err


def test_navigate_writes_a_track_and_a_picture(run, parked, aligned):
    outcome = run("navigate", parked, *SCALE, "--start", aligned, "--out", "track.parquet", "--plot", "track.png")
    assert outcome.status == 0
    assert "Free inertial navigation from 60 s to 80 s, 1000 samples" in outcome.out
    assert "track in track.parquet" in outcome.out
    table = parquet.read_table("track.parquet")
    assert tuple(table.column_names) == COLUMNS
    assert table.num_rows == 21
    assert Path("track.png").read_bytes()[:4] == b"\x89PNG"
    assert listed() == ["track.parquet", "track.png"]


def test_navigate_for_machines(run, parked, aligned):
    outcome = run(
        "navigate",
        parked,
        *SCALE,
        "--start",
        aligned,
        "--out",
        "track.csv",
        "--every",
        "5 s",
        "--to",
        "70 s",
        "--no-biases",
        "--json",
    )
    assert outcome.status == 0
    told = json.loads(outcome.out)
    assert (told["out"], told["begin"], told["stop"], told["rows"]) == ("track.csv", 60.0, 70.0, 3)
    assert told["final"]["heading"] == pytest.approx(40, abs=1)
    assert csv.read_csv("track.csv").num_rows == 3


def test_biases_make_a_difference(run, parked, aligned):
    def end(*options):
        outcome = run("navigate", parked, *SCALE, "--start", aligned, "--out", "track.csv", "--json", *options)
        return json.loads(outcome.out)["final"]["velocity_enu"]

    assert end() != end("--no-biases")


def test_measured_gravity_moves_a_free_height(run, parked, aligned):
    def height(*options):
        options = ("--vertical", "free", "--json", *options)
        outcome = run("navigate", parked, *SCALE, "--start", aligned, "--out", "track.csv", *options)
        return json.loads(outcome.out)["final"]["height"]

    g = normal_gravity(*PLACE)
    assert height("--gravity", f"{g + 1e-3!r} m/s^2") - height() == pytest.approx(-0.5e-3 * 20**2, rel=0.01)


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        (("--start", "nothing.json", "--out", "track.csv"), 2, "cannot read the alignment"),
        (("--start", "{aligned}", "--out", "track.txt"), 2, ".parquet or .csv"),
        (("--start", "{aligned}", "--out", "track.csv", "--plot", "track.gif"), 2, "--plot"),
        (("--start", "{aligned}", "--out", "{aligned}"), 2, "inputs are never modified"),
        (("--start", "{aligned}", "--out", "track.csv", "--every", "5"), 2, "--every"),
        (("--start", "{aligned}", "--out", "track.csv", "--to", "30 s"), 2, "no stretch of time"),
    ],
)
def test_navigate_says_what_is_wrong(run, parked, aligned, options, status, words):
    outcome = run("navigate", parked, *SCALE, *(o.format(aligned=aligned) for o in options))
    assert outcome.status == status
    assert words in outcome.err
    assert not listed()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--scale", "gyro=10 pulse/arcmin"),
            "multiplied by 2.90888209e-05, those that {aligned} was made of were by 4.8",
        ),
        (("--scale", "accel_y=4000 pulse/(m/s)"), "'accel_y [pulse]' are multiplied by 0.00025"),
        (("--units", "gyro=arcsec/s"), "'gyro_x [pulse]' are multiplied by 4.84813681e-06"),
        (("--map", "gyro_x=gyro_y [pulse]", "--map", "gyro_y=gyro_x [pulse]"), "give the same --map"),
    ],
)
def test_navigate_reads_as_its_alignment_did(run, parked, aligned, options, words):
    outcome = run("navigate", parked, *SCALE, *options, "--start", aligned, "--out", "track.csv")
    assert outcome.status == 2
    assert words.format(aligned=aligned) in " ".join(outcome.err.split())
    assert not listed()


def test_navigate_does_not_go_beyond_the_end(run, parked, aligned):
    outcome = run("navigate", parked, *SCALE, "--start", aligned, "--out", "track.csv", "--to", "300 s")
    assert outcome.status == 1
    assert "the samples end at 80 s, before the 300 s that were asked for (--to)" in " ".join(outcome.err.split())
    assert not listed()


def test_navigate_needs_to_know_the_place(run, parked, aligned):
    table = json.loads(aligned.read_text(encoding="utf-8"))
    table["place"] = []
    Path("bare.json").write_text(json.dumps(table), encoding="utf-8")
    outcome = run("navigate", parked, *SCALE, "--start", "bare.json", "--out", "track.csv")
    assert outcome.status == 2
    assert "it does not give latitude, longitude, height, v_east" in outcome.err
