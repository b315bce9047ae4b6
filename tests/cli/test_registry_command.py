"""``sagnac registry``: add, list, show, find, limits, upgrade."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from sagnac.calibration import Calibration, Fit, Site, UnitName, Value, load
from sagnac.registry.address import address
from sagnac.registry.database import Database
from sagnac.results import Software

MG = 9.80665e-3


def made(path, serial="0001", model="LG-1", day=1, bias=0.5 * MG, created=None):
    value = Value(name="accel.bias.x", value=bias, unit="m/s^2", standard_uncertainty=0.01 * MG)
    Calibration(
        method="norm",
        unit=UnitName(model=model, serial=serial),
        parameters=(value,),
        covariance=((value.standard_uncertainty**2,),),
        fit=Fit(chi2=9.0, degrees_of_freedom=10, residual_rms=1.0, converged=True, iterations=3),
        site=Site(gravity=9.81),
        software=Software(version="1.2.3"),
        created=created or f"2025-03-{day:02d}T12:00:00+00:00",
    ).save(path)
    return path


@pytest.fixture
def reg(run, monkeypatch, tmp_path):
    """Run a command on the registry of this test."""
    monkeypatch.setenv("SAGNAC_REGISTRY", str(tmp_path / "fleet.db"))

    def run_on_it(*arguments):
        return run("registry", *arguments)

    return run_on_it


@pytest.fixture
def fleet(reg, tmp_path):
    """Two units."""
    folder = tmp_path / "files"
    folder.mkdir()
    for name, how in (("a1", {}), ("a2", {"day": 9, "bias": 1.5 * MG}), ("b1", {"serial": "0002", "day": 5})):
        made(folder / f"{name}.json", **how)
    assert reg("add", folder).status == 0
    return reg


def test_add_tells_what_became_of_each_file(reg, tmp_path):
    path = made(tmp_path / "a.json")
    first, again = reg("add", path), reg("add", path)
    assert (first.status, again.status) == (0, 0)
    assert first.out.splitlines() == [
        f"{path}: registered as id:1, LG-1 0001, 2025-03-01 12:00:00 UTC",
        f"{tmp_path / 'fleet.db'}: 1 new",
    ]
    assert "already there as id:1" in again.out
    assert "0 new" in again.out


def test_a_refused_file_keeps_no_other_out(reg, tmp_path):
    (tmp_path / "b.json").write_text('{"schema": "sagnac/alignment/1"}')
    done = reg("add", made(tmp_path / "a.json"), tmp_path / "b.json", made(tmp_path / "c.json", serial="0002"))
    assert done.status == 2
    assert f"refused: {tmp_path / 'b.json'}: not a calibration" in done.err
    assert done.err.splitlines()[-1] == "sagnac: 1 file refused, see above; 2 are in the registry"
    assert "2 units with 2 calibrations" in reg("list").out


def test_one_file_that_is_refused(reg, tmp_path):
    done = reg("add", made(tmp_path / "a.json", serial=""))
    assert (done.status, done.out) == (2, "")
    assert done.err == f"sagnac: {tmp_path / 'a.json'}: names no serial number of the unit; say it with --serial\n"
    assert not (tmp_path / "fleet.db").exists()
    assert reg("add", tmp_path / "a.json", "--serial", "0042").status == 0
    assert "0042" in reg("list").out


def test_a_date_for_a_file_without(reg, tmp_path):
    path = made(tmp_path / "a.json", created="unknown")
    assert "say when it was made with --as-of" in reg("add", path).err
    assert "2020-02-03 00:00:00 UTC\n" in reg("add", path, "--as-of", "2020-02-03").out


def test_the_date_of_the_test_for_a_file_that_was_computed_later(reg, tmp_path):
    path = made(tmp_path / "a.json")
    both = "2019-01-01 00:00:00 UTC (its file says 2025-03-01 12:00:00 UTC)"
    assert both in reg("add", path, "--as-of", "2019-01-01").out
    assert both in reg("show", "0001").out
    assert json.loads(reg("find", "--at", "2019-02-01", "--json").out)["calibrations"][0]["stated"].startswith(
        "2025-03-01T12"
    )


def test_a_calibration_in_other_bytes_is_told(reg, tmp_path):
    path = made(tmp_path / "a.json")
    (tmp_path / "b.json").write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    reg("add", path)
    done = reg("add", tmp_path / "b.json")
    assert done.status == 0
    assert "already there as id:1, LG-1 0001, 2025-03-01 12:00:00 UTC (another file of the same unit" in done.out


def test_what_could_not_be_judged_is_told(reg, tmp_path):
    path = made(tmp_path / "a.json")
    path.write_text(path.read_text().replace('"m/s^2"', '"count"'))
    reg("add", path)
    assert reg("limits", "accel.bias.*=±9 count", "--model", "LG-1").status == 0
    assert reg("limits", "accel.bias.*=none", "--model", "LG-1").status == 0
    assert reg("list").out.splitlines()[1].split()[-1] == "-"
    reg("add", made(tmp_path / "b.json", serial="0002"))
    reg("limits", "accel.bias.*=±1 mg", "--model", "LG-1")
    lines = reg("list").out.splitlines()
    assert lines[1].endswith("undecided: accel.bias.x in another unit than the limit")
    assert lines[2].endswith("pass")


def test_add_for_machines(reg, tmp_path):
    (tmp_path / "b.json").write_text("{}")
    done = reg("add", made(tmp_path / "a.json"), tmp_path / "b.json", "--json")
    told = json.loads(done.out)
    assert done.status == 2
    assert [(f["id"], f["new"], f["serial"]) for f in told["files"]] == [(1, True, "0001")]
    assert told["refused"][0].startswith(str(tmp_path / "b.json"))


def test_list_names_the_units(fleet, tmp_path):
    lines = fleet("list").out.splitlines()
    assert lines[0].split() == ["model", "serial", "calibrations", "latest", "(UTC)", "method", "id", "limits"]
    assert lines[1].split() == ["LG-1", "0001", "2", "2025-03-09", "12:00:00", "norm", "id:2", "-"]
    assert lines[-1] == f"2 units with 3 calibrations in {tmp_path / 'fleet.db'}"
    assert "no calibrations of this kind" in fleet("list", "--model", "none").out
    assert "1 unit with 1 calibration" in fleet("list", "--since", "2025-03-06").out
    assert [u["serial"] for u in json.loads(fleet("list", "--json").out)["units"]] == ["0001", "0002"]


def test_list_of_one_unit_names_its_calibrations(fleet):
    lines = fleet("list", "--serial", "0001").out.splitlines()
    assert [line.split()[2] for line in lines[1:]] == ["id:1", "id:2"]
    assert [line.split()[2] for line in fleet("list", "--serial", "0001", "--limit", "1").out.splitlines()[1:]] == [
        "id:2"
    ]
    told = json.loads(fleet("list", "--serial", "0001", "--json", "--since", "2025-03-02").out)
    assert [c["id"] for c in told["calibrations"]] == [2]
    unknown = fleet("list", "--serial", "0003")
    assert (unknown.status, "did you mean 000" in unknown.err) == (2, True)


def test_show_gives_the_page_and_the_file(fleet, tmp_path):
    shown = fleet("show", "0001@2025-03-08")
    assert shown.out.startswith(f"id:1 of {tmp_path / 'fleet.db'}\n  made        2025-03-01 12:00:00 UTC\n")
    assert load(tmp_path / "files" / "a1.json").summary() in shown.out
    assert fleet("show", "id:1", "--out", tmp_path / "again.json").status == 0
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "files" / "a1.json").read_bytes()
    told = json.loads(fleet("show", "0002", "--json").out)
    assert told["calibration"] == json.loads((tmp_path / "files" / "b1.json").read_text())
    assert fleet("show", told["sha256"][:8], "--json").out == fleet("show", "0002", "--json").out


def test_show_does_not_write_over_the_registry(fleet, tmp_path):
    done = fleet("show", "0001", "--out", tmp_path / "fleet.db")
    assert (done.status, "is an input" in done.err) == (2, True)
    assert fleet("list").status == 0


def test_find_tells_what_was_in_force(fleet):
    lines = fleet("find", "--at", "2025-03-05").out.splitlines()
    assert [line.split()[1:3] for line in lines[1:]] == [["0001", "id:1"], ["0002", "id:3"]]
    assert [
        line.split()[2] for line in fleet("find", "--at", "2025-03-09", "--serial", "0001").out.splitlines()[1:]
    ] == ["id:2"]
    before = fleet("find", "--at", "2025-03-04", "--serial", "0002")
    assert (before.status, before.out) == (1, "")
    assert "no unit with serial number '0002' had a calibration yet at 2025-03-04 23:59:59 UTC" in before.err
    assert len(json.loads(fleet("find", "--at", "2025-03-05T12:00:00Z", "--json").out)["calibrations"]) == 2
    assert len(json.loads(fleet("find", "--at", "2025-03-05T11:59:59Z", "--json").out)["calibrations"]) == 1


def test_limits_are_set_and_judged_by(fleet, tmp_path):
    assert fleet("limits").out == f"no limits in {tmp_path / 'fleet.db'}\n"
    done = fleet("limits", "accel.bias.*=±1 mg", "--model", "LG-1", "--specification", "sheet 7")
    assert done.status == 0
    lines = fleet("limits").out.splitlines()
    assert lines[1].split()[:7] == ["LG-1", "all", "accel.bias.*", "-1", "1", "mg", "guarded"]
    assert lines[1].endswith("sheet 7")
    states = [(u["state"], u["beyond"]) for u in json.loads(fleet("list", "--json").out)["units"]]
    assert states == [("fail", ["accel.bias.x"]), ("pass", [])]
    assert "fail: accel.bias.x" in fleet("list", "--serial", "0001").out
    of_unit = ("--model", "LG-1", "--serial", "0001")
    assert fleet("limits", "accel.bias.x=2 mg", *of_unit).status == 0
    assert [u["state"] for u in json.loads(fleet("list", "--json").out)["units"]] == ["pass", "pass"]
    assert fleet("limits", "accel.bias.x=none", *of_unit).status == 0
    assert [u["state"] for u in json.loads(fleet("list", "--json").out)["units"]] == ["fail", "pass"]
    (line,) = fleet("limits", "--serial", "0001").out.splitlines()[1:]
    assert line.split()[:3] == ["LG-1", "all", "accel.bias.*"]


def test_limits_from_a_file_as_of_certificates(fleet, tmp_path):
    (tmp_path / "limits.toml").write_text(
        'rule = "simple acceptance"\nspecification = "sheet 8"\n[limits]\n"accel.bias.x" = ["-2 mg", "2 mg"]\n'
    )
    assert fleet("limits", "limits.toml", "--model", "LG-1", "--from", "2025-01-01").status == 0
    (told,) = json.loads(fleet("limits", "--json", "--at", "2025-01-01").out)["limits"]
    assert (told["rule"], told["specification"], told["valid_from"]) == (
        "simple acceptance", "sheet 8", "2025-01-01T00:00:00+00:00",
    )  # fmt: skip
    assert told["upper"] == pytest.approx(2 * MG)
    assert json.loads(fleet("limits", "--json", "--at", "2024-12-31").out)["limits"] == []
    assert (
        "says rule and specification itself"
        in fleet("limits", "limits.toml", "--model", "LG-1", "--rule", "simple").err
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("accel.bias.x=1 mg",), "--model: say which model the limits are for"),
        (("accel.bias.x", "--model", "LG-1"), "write parameter=limit"),
        (("accel.bias.x=1 mg", "accel.bias.x=2 mg", "--model", "LG-1"), "accel.bias.x is given twice"),
        (("accel.bias.x=1 deg/h", "--model", "LG-1"), "deg / h where m/s^2 is needed"),
        (("gyro.bias.x=1 deg/h", "--model", "LG-1"), "meets no parameter of the calibrations"),
        (("missing.toml", "--model", "LG-1"), "missing.toml"),
        (("accel.bias.x=1 mg", "--model", "LG-1", "--at", "2025-01-01"), "--at: has no meaning here, limits are set"),
        (("--rule", "simple", "--from", "2025-01-01"), "--from, --rule: has no meaning here, no limits are given"),
    ],
)
def test_limits_that_are_none(fleet, arguments, said):
    done = fleet("limits", *arguments)
    assert (done.status, said in done.err) == (2, True), done.err


def test_a_registry_of_an_earlier_version_is_brought_up_when_asked(reg, tmp_path):
    database = Database(address(tmp_path / "fleet.db"), write=True)
    database.upgrade("0001")
    database.close()
    done = reg("add", made(tmp_path / "a.json"))
    assert (done.status, "bring it up with `sagnac registry upgrade`" in done.err) == (2, True)
    assert "brought from 0001 to 0002" in reg("upgrade").out
    assert "tables are at 0002" in reg("upgrade").out
    assert json.loads(reg("upgrade", "--json").out)["before"] == "0002"
    assert reg("add", tmp_path / "a.json").status == 0


def test_where_there_is_none(reg, run, tmp_path):
    for arguments in (("list",), ("show", "0001"), ("find", "--at", "2025-01-01"), ("limits",), ("upgrade",)):
        done = reg(*arguments)
        assert (done.status, "there is no registry; `sagnac registry add` makes one" in done.err) == (2, True)
    assert list(tmp_path.iterdir()) == []


def test_a_password_is_not_shown(run):
    done = run("registry", "list", "--registry", "postgresql://me:secret@127.0.0.1:1/fleet")
    assert (done.status, "secret" in done.err, "no server answers there" in done.err) == (2, False, True)


def test_without_the_extra_the_user_is_told_what_to_install(reg, monkeypatch):
    monkeypatch.setitem(sys.modules, "sqlalchemy", None)
    done = reg("list")
    assert (done.status, "pip install 'sagnac[registry]'" in done.err) == (2, True)


def test_two_files_are_compared_without_the_extra(tmp_path):
    files = [str(made(tmp_path / "a.json")), str(made(tmp_path / "b.json", day=2))]
    code = (
        "import sys; sys.modules |= dict.fromkeys(('sqlalchemy', 'alembic', 'psycopg'))\n"
        "from sagnac.cli import main\n"
        f"sys.argv = ['sagnac', 'registry', 'compare', *{files!r}]; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
