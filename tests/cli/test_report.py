"""``sagnac report``: certificates and pages of alignments as files."""

from __future__ import annotations

import io
import json
import re

import pytest

from sagnac.calibrate import calibrate
from sagnac.recording import open_recording


@pytest.fixture(scope="module")
def lab(rig, rig_again, tmp_path_factory):
    """A calibration with its recording and plan beside it, and one of another recording of the same unit."""
    folder = tmp_path_factory.mktemp("lab")
    for file in (rig.recording, rig.plan_file, rig_again.recording, rig_again.plan_file):
        (folder / file.name).write_bytes(file.read_bytes())
    again = open_recording(folder / "again.parquet", scale=rig.plan.unit.scale)
    calibrate("norm", again, rig.plan).save(folder / "again.json")
    recording = open_recording(folder / "recording.parquet", scale=rig.plan.unit.scale)
    calibrate("norm", recording, rig.plan).with_source(folder / "plan.toml", "plan").save(folder / "cal.json")
    return folder


LAB = "<lab>/"


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """A covariance analysis of a short course: result and history."""
    from sagnac.align.transfer import covariance

    folder = tmp_path_factory.mktemp("aligned")
    (folder / "config.toml").write_text(CONFIG)
    covariance(folder / "config.toml", folder / "out")
    return folder / "out"


CONFIG = """
method = "wander"
update_interval = "1 s"
[initial]
misalignment = "0.2 deg"
velocity = "0.2 m/s"
gyro_bias = "0.01 deg/h"
accel_bias = "50 ug"
[noise]
velocity = "0.01 m/s"
gyro = "0.001 deg/sqrt(h)"
accel = "1 ug/sqrt(Hz)"
[trajectory]
latitude = "60 deg"
longitude = "108 deg"
speed = "10 m/s"
heading = "90 deg"
[[trajectory.leg]]
duration = "20 s"
"""


def test_a_certificate_is_written_in_both_forms(run, lab, tmp_path):
    pypdf = pytest.importorskip("pypdf")
    pytest.importorskip("typst")
    done = run("report", lab / "cal.json", "--out", "c.html", "--out", "c.pdf")
    assert (done.status, done.out) == (0, "c.html\nc.pdf\n")
    page = (tmp_path / "c.html").read_text()
    assert "Calibration certificate" in page
    assert "not found" not in page
    assert len(page) < 1_000_000
    reader = pypdf.PdfReader(io.BytesIO((tmp_path / "c.pdf").read_bytes()))
    (attached,) = reader.attachments.values()
    assert attached == [(lab / "cal.json").read_bytes()]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.html", "c.pdf"]


def test_everything_that_can_be_added_is_added(run, lab, tmp_path):
    (tmp_path / "d.toml").write_text('number = "C-77"\n[laboratory]\nname = "Lab <&> #x"\n')
    (tmp_path / "l.toml").write_text('rule = "simple acceptance"\n[limits]\n"accel.bias.*" = "4 mg"\n')
    options = ("--check", lab / "again.parquet", "--check-plan", lab / "again.toml", "--as-found", lab / "again.json")
    more = ("--details", "d.toml", "--limits", "l.toml", "-k", "3")
    assert run("report", lab / "cal.json", "--out", "c.html", *options, *more).status == 0
    page = (tmp_path / "c.html").read_text()
    for words in (
        "C-77",
        "Lab &lt;&amp;&gt; #x",
        "Simple acceptance",
        "99.73 %",
        "As found, as left",
        "3 pass, 0 fail",
    ):
        assert words in page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "c.txt"), "--out c.txt: a report is written to a .html or .pdf file"),
        (("--out", "c"), "a report is written to"),
        (("--out", "c.html", "--out", "c.html"), "written by --out already"),
        (("--out", "c.html", "-k", "0"), "a coverage factor of 0"),
        (("--out", "c.html", "--limits", "none.toml"), "cannot read the limits"),
        (("--out", "c.html", "--details", "none.toml"), "cannot read the details"),
        (("--out", "c.html", "--check-plan", "none.toml"), "(--check)"),
        (("--out", "c.html", "--check", LAB + "recording.parquet"), "recording that the calibration was made from"),
        (("--out", "c.html", "--check", LAB + "again.parquet"), "(--check-plan)"),
        (("--out", "c.html", "--earlier", LAB + "cal.json"), "given twice"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_is_written(run, lab, tmp_path, arguments, message):
    done = run("report", lab / "cal.json", *(str(a).replace(LAB, f"{lab}/") for a in arguments))
    assert done.status == 2
    assert message in done.err
    assert list(tmp_path.iterdir()) == []


def test_inputs_are_not_overwritten(run, lab, tmp_path):
    (tmp_path / "cal.html").write_bytes((lab / "cal.json").read_bytes())
    before = (tmp_path / "cal.html").read_bytes()
    done = run("report", "cal.html", "--out", "cal.html")
    assert done.status == 2
    assert (tmp_path / "cal.html").read_bytes() == before


def test_another_recording_is_refused(run, lab, tmp_path):
    (tmp_path / "other.csv").write_text("time [s],accel_x [g]\n0,1\n1,1\n")
    done = run("report", lab / "cal.json", "--out", "c.html", "--recording", "other.csv")
    assert done.status == 2
    assert "not the recording that the calibration was made from" in done.err


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"schema": "sagnac/alignment/1"}', '{"schema": 7}'])
def test_files_that_are_no_results_are_refused(run, tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    done = run("report", "x.json", "--out", "c.html")
    assert done.status == 2
    assert not (tmp_path / "c.html").exists()


def test_hostile_names_do_not_get_out_of_a_certificate(run, lab, tmp_path):
    table = json.loads((lab / "cal.json").read_text())
    bad = "</script><script>alert(1)</script> #panic() $x$ \u202e \ud83d\ude00 " + "w" * 3000
    table["unit"]["model"] = table["unit"]["serial"] = bad
    table["remarks"] = [bad, "שלום"]
    table["source"] = [{"file": bad, "sha256": "0" * 64, "role": "recording"}]
    (tmp_path / "cal.json").write_text(json.dumps(table))
    outs = ["--out", "c.html"]
    try:
        import typst  # noqa: F401 - whether it is there

        outs += ["--out", "c.pdf"]
    except ImportError:
        pass
    assert run("report", "cal.json", *outs).status == 0
    page = (tmp_path / "c.html").read_text()
    assert re.findall(r"<script[^>]*>", page) == ['<script type="application/json" data-name="cal.json">']


def test_an_alignment_gets_its_own_page(run, aligned, tmp_path):
    assert run("report", aligned / "alignment.json", "--out", "a.html").status == 0
    page = (tmp_path / "a.html").read_text()
    for words in ("Covariance analysis", "Predicted without data", "misalignment.z", "Figure 1."):
        assert words in page
    assert "Not drawn" not in page
    (tmp_path / "alone.json").write_bytes((aligned / "alignment.json").read_bytes())
    assert run("report", "alone.json", "--out", "b.html").status == 0
    assert "history.parquet" in (tmp_path / "b.html").read_text()


def test_the_history_of_another_alignment_is_not_drawn(run, aligned, tmp_path):
    (tmp_path / "history.parquet").write_bytes((aligned / "history.parquet").read_bytes())
    other = json.loads((aligned / "alignment.json").read_text())
    (tmp_path / "alignment.json").write_text(json.dumps({**other, "time": 7.0}))
    (tmp_path / "other.json").write_text(json.dumps(other))
    assert run("report", "other.json", "--out", "a.html").status == 0
    assert "the history of another alignment" in (tmp_path / "a.html").read_text()


def test_an_alignment_takes_no_limits(run, aligned, tmp_path):
    (tmp_path / "l.toml").write_text('[limits]\n"accel.bias.*" = "4 mg"\n')
    done = run("report", aligned / "alignment.json", "--out", "a.html", "--limits", "l.toml")
    assert done.status == 2
    assert "takes no --limits" in done.err


def test_the_folder_of_an_alignment_will_do(run, aligned, tmp_path):
    assert run("report", aligned, "--out", "a.html").status == 0
    assert "Covariance analysis" in (tmp_path / "a.html").read_text()
    done = run("report", tmp_path, "--out", "b.html")
    assert (done.status, "alignment.json: cannot be read" in done.err) == (2, True)


def test_a_recording_is_no_result(run, lab):
    done = run("report", lab / "recording.parquet", "--out", "c.html")
    assert done.status == 2
    assert "recording.parquet: is no calibration or alignment file (JSON)" in done.err


def test_what_is_missing_and_what_is_wrong_is_told_at_the_terminal(run, lab, tmp_path):
    (tmp_path / "alone.json").write_text((lab / "cal.json").read_text().replace(str(lab), "/no/such/folder"))
    (tmp_path / "d.toml").write_text('[[standard]]\nname = "Level"\nvalid_until = 2001-01-01\n')
    done = run("report", "alone.json", "--out", "c.html", "--details", "d.toml")
    assert done.status == 0
    assert "give it with --recording" in done.err
    assert "give it with --plan" in done.err
    assert "warning: the standard 'Level' was valid until 2001-01-01" in done.err
    page = re.sub(
        r"<script.*?</script>|<style.*?</style>|<svg.*?</svg>", "", (tmp_path / "c.html").read_text(), flags=re.DOTALL
    )
    assert "valid until 2001-01-01" in page
    assert not re.search(r"--[a-z]", page)


def test_characters_without_a_font_are_named(run, lab, tmp_path):
    pytest.importorskip("typst")
    # a private use character is shown as unknown; of Egyptian hieroglyphs no usual machine has a font
    (tmp_path / "d.toml").write_text('number = "N \U00013080"\n', encoding="utf-8")
    done = run("report", lab / "cal.json", "--out", "c.pdf", "--out", "c.html", "--details", "d.toml")
    assert done.status == 0
    assert "warning: c.pdf: no font at hand has" in done.err
    assert "(U+13080)" in done.err
    assert "c.html: " not in done.err


def test_calibrate_says_what_it_has_written(run, lab, tmp_path):
    files = ("--out", "cal.json", "--certificate", "c.html", "--plot", "log.svg")
    done = run("calibrate", "norm", lab / "recording.parquet", "--plan", lab / "plan.toml", *files)
    assert done.status == 0
    assert [line for line in done.err.splitlines() if line.startswith("written")] == [
        "written: cal.json",
        "written: log.svg",
        "written: c.html",
    ]
    assert all((tmp_path / name).exists() for name in files[1::2])
