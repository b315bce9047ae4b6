"""The published schemas of trends and comparisons."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest
from histories import history_of, one

from sagnac.limits import Limit
from sagnac.registry import Parameter, compare, fleet, trend, trend_records

UG = 9.80665e-6
YEARS = np.arange(5.0)


def records():
    history = one(YEARS, UG * YEARS**2, UG)
    units = history_of([(i, Parameter("accel.bias.x", "m/s^2"), YEARS, i * UG * YEARS, UG) for i in (1, 2)])
    return [
        (trend_records, trend.trend(history, limit_of=lambda _: Limit(-UG, np.inf))),
        (trend_records, trend.trend(one(YEARS[:1], UG * YEARS[:1], UG))),
        (fleet, fleet.fleet(units, limit_of=lambda _, __: Limit(-UG, UG))),
    ]


@pytest.mark.parametrize("module", [trend_records, fleet, compare])
def test_the_published_schema_is_that_of_the_records(module):
    assert module.SCHEMA_FILE.read_text(encoding="utf-8") == json.dumps(module.json_schema(), indent=2) + "\n"


@pytest.mark.parametrize(("module", "record"), records())
def test_what_is_written_agrees_with_its_schema(module, record):
    jsonschema.validate(json.loads(record.to_json()), json.loads(module.SCHEMA_FILE.read_text(encoding="utf-8")))
