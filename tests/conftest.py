"""Settings and recordings that many tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from sagnac.plan import Plan
from sagnac.recording import Recording, open_recording
from sagnac.simulate.plans import ICOSAHEDRON, table_plan
from sagnac.simulate.table import imperfect_table, simulate_recording, write_recording
from sagnac.simulate.unit import laser_gyro_unit

settings.register_profile(
    "house",
    deadline=None,  # the first call of pint, pyarrow or a kernel takes its time
    derandomize=True,  # a failure found once is found again
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.register_profile("thorough", parent=settings.get_profile("house"), derandomize=False, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "house"))


@dataclass(frozen=True)
class Rig:
    """A short run of the laser-gyro unit on its table, as files."""

    recording: Path
    plan_file: Path
    plan: Plan


@pytest.fixture(scope="session")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Twelve static and twelve turning positions at 20 Hz, 11.5 minutes in all."""
    folder = tmp_path_factory.mktemp("rig")
    unit, rng = laser_gyro_unit(), np.random.default_rng(20)
    plan = table_plan(unit, ICOSAHEDRON, dwell=16.0, turning=36.0, move=3.0)
    time, samples = simulate_recording(unit, plan, imperfect_table(plan, rng), rng, frequency=20.0)
    write_recording(str(folder / "recording.parquet"), time, samples, unit.pulses)
    plan.save(folder / "plan.toml")
    return Rig(folder / "recording.parquet", folder / "plan.toml", plan)


@pytest.fixture(scope="session")
def rig_again(rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """The same unit and plan once more, with other noise and other errors of the table."""
    folder = tmp_path_factory.mktemp("rig_again")
    unit, rng = laser_gyro_unit(), np.random.default_rng(21)
    time, samples = simulate_recording(unit, rig.plan, imperfect_table(rig.plan, rng), rng, frequency=20.0)
    write_recording(str(folder / "again.parquet"), time, samples, unit.pulses)
    rig.plan.save(folder / "again.toml")
    return Rig(folder / "again.parquet", folder / "again.toml", rig.plan)


@pytest.fixture(scope="session")
def public_data() -> Callable[[str], Path]:
    """Takes the name of a public recording to its path; a test that asks for one that is not at hand is skipped."""
    folder = Path(os.environ.get("SAGNAC_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))

    def find(name: str) -> Path:
        if not (folder / name).exists():
            pytest.skip(f"{name} is not at hand (set SAGNAC_DATA to its folder)")
        return folder / name

    return find


@pytest.fixture(scope="session")
def parked_log(public_data: Callable[[str], Path]) -> Recording:
    """The public laser-gyro log of a parked vehicle (PSINS data set): 0.1 arcsec and 1.2225e-3 m/s a pulse."""
    scale = {"gyro": "10 pulse/arcsec", "accel": f"{1 / 1.2225e-3!r} pulse/(m/s)"}
    return open_recording(public_data("laser_gyro_parked.parquet"), scale=scale)
