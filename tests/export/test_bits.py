"""The C has the bits of the Python `step`: over every bundled log, and on random inputs."""

import ctypes
import math
from functools import cache
from itertools import pairwise

import pytest
from helpers.c_library import CMethod, W
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core import bundled, estimator
from adhesion_cli.core.estimator import Sample
from adhesion_cli.core.methods import Method, validate
from adhesion_cli.core.model import Vehicle, quantities
from adhesion_cli.export import files, vectors
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.wsp.controller import Observed

METHODS = files.methods()
VEHICLE = Vehicle()
ESTIMATORS = estimator.registry()
LOGS = sorted(p.name for p in bundled.folder("sample_logs").glob("*.[cm][sc][va]*"))


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    """Each export, compiled when it is first asked for."""
    folder = tmp_path_factory.mktemp("exports")
    return cache(lambda name: CMethod(folder, name))


@cache
def segments(name):
    """Samples (h [s], K [N], y [rad/s]) of every segment of every axle of a bundled log."""
    log = read(open_source(bundled.folder("sample_logs") / name, ReadOptions()), [], Vehicle())
    found = []
    for record in prepare(log, Vehicle()).records:
        for s in record.segments:
            t = record.t[s].tolist()
            h = [0.0, *((b - a) * 1e-9 for a, b in pairwise(t))]
            K, y = record.clamping_force[s].tolist(), record.wheel_speed[s].tolist()
            found.append(list(zip(h, K, y, strict=True)))
    return found


def runs_alike(c, est, p, samples):
    """Runs both; every number of the state is the same after each sample."""
    state = est.init(p, W, *samples[0][1:])
    assert c.init(p, samples[0][1:]) == "OK"
    assert c.has(state)
    for h, K, y in samples[1:]:
        state = est.step(p, W, state, h, K, y)
        assert c.step(h, (K, y)) == "OK"
        assert c.has(state)


def test_every_bundled_log_is_there():
    """The MCAP has the same samples as the CSV of its name, so one of them is run."""
    assert LOGS == ["low-adhesion.csv", "low-adhesion.mcap", "service-brake.csv"]
    assert segments("low-adhesion.mcap") == segments("low-adhesion.csv")


@pytest.mark.parametrize("log", [x for x in LOGS if x.endswith(".csv")])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_on_a_log(compiled, name, log):
    est = ESTIMATORS[name]
    for samples in segments(log):
        runs_alike(compiled(name), est, validate(est, {}), samples)


def numbers(of, *names):
    """Values in the ranges of the annotated types, with their ends."""
    known = quantities(of)
    return st.tuples(*(st.floats(known[x].minimum, known[x].maximum) for x in names))


def some(method: Method):
    """Parameters anywhere in their ranges."""
    known = quantities(method.Params)
    high = {name: min(q.maximum, 1e9) for name, q in known.items()}
    values = {name: st.floats(q.minimum, high[name]) for name, q in known.items()}
    defaults = method.Params()
    return st.one_of(st.just(defaults), st.builds(method.Params, **values))


plausible = st.tuples(st.floats(1e-4, 0.2), st.floats(0.0, 3e4), st.floats(0.0, 60.0))
samples = st.lists(st.one_of(plausible, numbers(Sample, "h", "K", "y")), min_size=2, max_size=8)


@pytest.mark.parametrize("name", ESTIMATORS)
@settings(max_examples=25)
@given(data=st.data())
def test_an_estimator_on_random_inputs(compiled, name, data):
    """Where Python raises or has no finite answer, C returns a status and keeps its state."""
    est, c = ESTIMATORS[name], compiled(name)
    p, rows = data.draw(some(est)), data.draw(samples)
    state = est.init(p, W, *rows[0][1:])
    assert c.init(p, rows[0][1:]) == "OK"
    for h, K, y in rows[1:]:
        status = c.step(h, (K, y))
        if h > est.longest_step(p):
            assert status == "TOO_LONG"
            continue
        try:
            after = est.step(p, W, state, h, K, y)
        except (ZeroDivisionError, OverflowError, ValueError):
            assert status in ("OK", "NOT_FINITE")
            return
        answers = [after.F, after.sigma] if est.has_sigma else [after.F]
        if all(map(math.isfinite, answers)):
            assert status == "OK"
            state = after
        else:
            assert status == "NOT_FINITE"
        assert c.has(state)


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(ESTIMATORS)))
def test_a_control_law_on_a_log(compiled, name):
    law, c = METHODS[name], compiled(name)
    p = validate(law, {})
    rows = vectors.of_controller(law, p, {}, VEHICLE).rows
    state = law.init(p, Observed(*rows[0][1:]))
    assert c.init(p, rows[0][1:]) == "OK"
    valves = set()
    for h, *observed in rows[1:]:
        state = law.step(p, state, h, Observed(*observed))
        assert c.step(h, observed) == "OK"
        assert c.has(state)
        valves.add(state.valve)
    assert valves == {0, 1, 2}


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(ESTIMATORS)))
@settings(max_examples=25)
@given(data=st.data())
def test_a_control_law_on_random_inputs(compiled, name, data):
    law, c = METHODS[name], compiled(name)
    p = data.draw(some(law))
    q = quantities(Observed)
    each = [st.floats(x.minimum, x.maximum) for x in q.values()]
    near = [st.floats(x.minimum, min(x.maximum, 0.4)) if n == "slip" else s
            for (n, x), s in zip(q.items(), each, strict=True)]  # fmt: skip
    slope = list(q).index("slope")
    near[slope] = st.one_of(st.just(math.nan), st.floats(-0.1, 0.1), each[slope])
    near[-1] = st.integers(0, 2)
    rows = data.draw(st.lists(st.tuples(st.floats(1e-6, 10.0), *near), min_size=2, max_size=12))
    state = law.init(p, Observed(*rows[0][1:]))
    assert c.init(p, rows[0][1:]) == "OK"
    for h, *observed in rows[1:]:
        state = law.step(p, state, h, Observed(*observed))
        assert c.step(h, observed) == "OK"
        assert c.has(state)


@pytest.mark.parametrize("name", METHODS)
def test_what_is_out_of_range_is_refused(compiled, name):
    """By a status; the state keeps every bit."""
    method, c = METHODS[name], compiled(name)
    p, of = method.Params(), Observed if name not in ESTIMATORS else Sample
    known = dict(list(quantities(of).items())[0 if of is Observed else 1 :])
    good = [0.5 * (q.minimum + q.maximum) for q in known.values()]
    assert c.init(p, good) == "OK"
    assert c.step(0.01, good) == "OK"
    kept = bytes(c.memory)
    for field, q in quantities(method.Params).items():
        for bad in (
            math.nan,
            math.nextafter(q.minimum, -math.inf),
            math.nextafter(q.maximum, math.inf),
        ):
            assert c.init(p._replace(**{field: bad}), good) == "BAD_PARAMETER"
    read = [i for i, x in enumerate(known) if of is Sample or (x in c.read and x != "at_least")]
    for i in read:
        q = list(known.values())[i]
        bad = [math.nextafter(q.minimum, -math.inf), math.nextafter(q.maximum, math.inf), math.inf]
        for x in [*bad, *([] if q.optional else [math.nan])]:
            assert c.step(0.01, [*good[:i], x, *good[i + 1 :]]) == "BAD_INPUT"
            assert c.init(p, [*good[:i], x, *good[i + 1 :]]) == "BAD_INPUT"
    for h in (0.0, -1.0, 11.0, math.nan, math.inf):
        assert c.step(h, good) == "BAD_INPUT"
    if name in ESTIMATORS:
        assert c.init(p, good, W._replace(radius=2.0)) == "BAD_WHEELSET"
        assert c.init(p, good, W._replace(a=2.0 * W.a)) == "BAD_WHEELSET"
    assert bytes(c.memory) == kept


@pytest.mark.parametrize("byte", [0x00, 0x3F, 0xA5, 0xFF])
@pytest.mark.parametrize("name", METHODS)
def test_a_state_without_init_is_refused(compiled, name, byte):
    method, c = METHODS[name], compiled(name)
    of = Sample if name in ESTIMATORS else Observed
    known = list(quantities(of).values())[1 if of is Sample else 0 :]
    good = [0.5 * (q.minimum + q.maximum) for q in known]
    ctypes.memset(c.memory, byte, ctypes.sizeof(c.memory))
    assert c.step(0.01, good) == "NOT_BEGUN"
    refused = {next(iter(method.Params._fields)): math.nan}
    assert c.init(method.Params()._replace(**refused), good) == "BAD_PARAMETER"
    assert c.step(0.01, good) == "NOT_BEGUN"
    assert c.init(method.Params(), good) == "OK"
    assert c.step(0.01, good) == "OK"


def test_null_is_refused(compiled):
    c = compiled("td")
    assert c.statuses[c.library.adhesion_td_init(None, None, None)] == "BAD_POINTER"
