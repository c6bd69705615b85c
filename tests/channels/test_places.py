"""Which axles a channel serves by its name."""

import pytest
from helpers.pasted import pasted

from adhesion_cli.analysis import settings
from adhesion_cli.channels.log import needed
from adhesion_cli.channels.meaning import understood
from adhesion_cli.channels.rules import place_of
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.formats.memory import MemorySource, Signals
from adhesion_cli.formats.source import Field

AXLES = [f"axle {n} speed [km/h]" for n in (1, 2, 3, 4)]
CARS = [f"Car {car} axle {n} speed [km/h]" for car in (1, 2) for n in (1, 2)]


def served(names: list[str]) -> tuple[dict[str, list[int | None]], list[Finding]]:
    """The axles of each channel with a meaning, by its name; and the findings."""
    meant, findings = understood([Field(n) for n in names], ())
    axles: dict[str, list[int | None]] = {}
    for m in meant:
        if m.meaning:
            axles.setdefault(m.title, []).append(m.axle)
    return axles, findings


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["1架制动缸压力(bar)", "2架制动缸压力(bar)"], [[1, 2], [3, 4]]),
        (["1转向架制动缸压力(bar)", "2转向架制动缸压力(bar)"], [[1, 2], [3, 4]]),
        (["一架制动缸压力(bar)", "二架制动缸压力(bar)"], [[1, 2], [3, 4]]),
        (["架1制动缸压力(bar)", "架2制动缸压力(bar)"], [[1, 2], [3, 4]]),
        (["CW1_BC_PRESS_BOGIE1 [kPa]", "CW1_BC_PRESS_BOGIE2 [kPa]"], [[1, 2], [3, 4]]),
        (["Bogie A BCP [bar]", "Bogie B BCP [bar]"], [[1, 2], [3, 4]]),
        (["C-Druck DG I [bar]", "C-Druck DG II [bar]"], [[1, 2], [3, 4]]),
        (["Front bogie BCP [bar]", "Rear bogie BCP [bar]"], [[1, 2], [3, 4]]),
        (["BCP bogie rear axle 3 [bar]", "BCP bogie rear axle 4 [bar]"], [[3], [4]]),
        (["C-Druck Drehgestell vorn", "C-Druck Drehgestell hinten"], [[1, 2], [3, 4]]),
        (["前转向架制动缸压力(bar)", "后转向架制动缸压力(bar)"], [[1, 2], [3, 4]]),
        ([f"BCP {letter} [bar]" for letter in "ABCD"], [[1], [2], [3], [4]]),
        ([f"BCP axle {n} [bar]" for n in ("I", "II", "III", "IV")], [[1], [2], [3], [4]]),
        (["BCU2.BCP [bar]"], [[None]]),
        (["Car 2 BCP [bar]"], [[None]]),
        (["CH7 BC pressure [bar]"], [[None]]),
        (["AI 3/BC pressure [bar]"], [[None]]),
        (["p_BC SN12 [bar]"], [[None]]),
        (["WSP2_BCP [bar]"], [[None]]),
        (["Ciśnienie cylindra hamulcowego [bar]"], [[None]]),
        (["BCU1.BCP1 [bar]", "BCU1.BCP2 [bar]"], [[1], [2]]),
        (["Pressure1 DB12 [bar]", "Pressure2 DB12 [bar]"], [[1], [2]]),
        ([r"BCP1\CAN-Monitoring:3", r"BCP2\CAN-Monitoring:3"], [[1], [2]]),
    ],
)
def test_a_number_next_to_something_else_is_no_axle(
    names: list[str], expected: list[list[int | None]]
) -> None:
    axles, _ = served([*names, *AXLES])
    assert [axles[name] for name in names] == expected
    assert [axles[name] for name in AXLES] == [[1], [2], [3], [4]]


def test_six_axles_in_two_bogies_are_three_each() -> None:
    speeds = [f"axle {n} speed [km/h]" for n in range(1, 7)]
    axles, _ = served([*speeds, "BCP bogie 1 [bar]", "BCP bogie 2 [bar]"])
    assert list(axles.values())[6:] == [[1, 2, 3], [4, 5, 6]]


def test_letters_of_axles_behind_a_car_are_counted_on() -> None:
    names = [f"M{car} {x} A{n}" for x in ("speed", "BCP") for car in (1, 2) for n in (1, 2)]
    axles, _ = served(names)
    assert list(axles.values()) == 2 * [[1], [2], [3], [4]]


def test_letters_of_cabs_are_no_axles() -> None:
    axles, _ = served(["BCP [bar]", "v cab A [km/h]", "v cab B [km/h]"])
    assert axles == {"BCP [bar]": [None], "v cab A [km/h]": [None]}


def test_an_actual_speed_with_a_number_is_a_wheel_s() -> None:
    meant, _ = understood([Field(f"vR_{n}_ist [km/h]") for n in (1, 2)], ())
    assert [(m.meaning, m.axle) for m in meant] == [("wheel_speed", 1), ("wheel_speed", 2)]


@pytest.mark.parametrize("word", ["CH{}", "AI {}/", "WSP{}_", "Kanal {}: "])
def test_inputs_are_counted_where_nothing_else_is(word: str) -> None:
    names = [word.format(n) + "wheel speed [km/h]" for n in (1, 2)]
    axles, _ = served([*names, word.format(5) + "BC pressure [bar]"])
    assert list(axles.values()) == [[1], [2], [None]]


@pytest.mark.parametrize(
    ("speed", "pressure"),
    [
        ("Car{} axle{} [km/h]", "Car{} BCP [bar]"),
        ("BCU{}.WheelSpeed{} [km/h]", "BCU{}.BCP [bar]"),
        ("Car {} axle {} [km/h]", "Car {} BCP [bar]"),
        ("{}车{}轴速度(km/h)", "{}车制动缸压力(bar)"),
        ("Car DM{} axle {} [km/h]", "Car DM{} BCP [bar]"),
    ],
)
def test_axles_that_each_car_counts_from_one_are_counted_on(speed: str, pressure: str) -> None:
    speeds = [speed.format(car, n) for car in (1, 2) for n in (1, 2)]
    axles, findings = served([*speeds, *map(pressure.format, (1, 2))])
    assert [axles[name] for name in speeds] == [[1], [2], [3], [4]]
    assert [axles[pressure.format(car)] for car in (1, 2)] == [[1, 2], [3, 4]]
    assert [f.code for f in findings] == ["bogie-pressure", "bogie-pressure", "axles-counted-on"]


@pytest.mark.parametrize("word", ["Run", "test", "Versuch", "Messung"])
def test_a_second_run_is_no_second_car(word: str) -> None:
    names = [f"{word} {n} {x}" for n in (1, 2) for x in ("axle 1 speed [km/h]", "BC 1 [bar]")]
    axles, findings = served(names)
    assert axles == {names[0]: [1], names[1]: [1]}
    assert [f.code for f in findings] == ["channel-ambiguous", "channel-ambiguous"]


@pytest.mark.parametrize(
    ("speed", "pressure"),
    [
        ("Channel 3{n} axle {n} speed [km/h]", "Channel {n} BC pressure [bar]"),
        ("v{n} [km/h]", "p_in_{n} [bar]"),
        ("ws{n} [km/h]", "BC_in{n} [bar]"),
        ("axle {n} speed [km/h]", "Input {n} BC pressure [bar]"),
        ("Achse {n} v [km/h]", "Eingang {n} Druck [bar]"),
        ('wheel_speed{{sensor="{n}"}} [km/h]', 'bc_pressure{{sensor="{n}"}} [bar]'),
        ('{{name="wheel_speed_{n}"}} [km/h]', '{{name="bc_pressure_{n}"}} [bar]'),
        ('value{{signal="wheel_speed_{n}"}}', 'value{{signal="bc_pressure_{n}"}}'),
        ("[1.{n}] speed [km/h]", "[1.{n}] BC [bar]"),
        ("WS {n}/2 [km/h]", "BCP {n}/2 [bar]"),
        ('speed{{sensor="{n}"}} [km/h]', 'bc{{sensor="{n}", job="train"}} [bar]'),
    ],
)
def test_numbers_that_alone_tell_channels_apart_are_axles(speed: str, pressure: str) -> None:
    names = [x.format(n=n) for x in (speed, pressure) for n in (1, 2)]
    axles, _ = served(names)
    assert [axles[name] for name in names] == [[1], [2], [1], [2]]


def test_four_of_four_are_no_bogies() -> None:
    axles, _ = served([*AXLES, *(f"BCP {n}/4 [bar]" for n in (1, 2, 3, 4))])
    assert list(axles.values()) == 2 * [[1], [2], [3], [4]]


def test_axles_that_each_bogie_counts_from_one_are_counted_on() -> None:
    names = [f"{bogie}架{axle}轴速度(km/h)" for bogie in (1, 2) for axle in (1, 2)]
    assert list(served(names)[0].values()) == [[1], [2], [3], [4]]


def test_axles_that_are_counted_over_the_train_stay() -> None:
    speeds = ["Car1 axle1 [km/h]", "Car1 axle2 [km/h]", "Car2 axle3 [km/h]", "Car2 axle4 [km/h]"]
    axles, findings = served([*speeds, "Car1 BCP [bar]", "Car2 BCP [bar]"])
    assert list(axles.values()) == [[1], [2], [3], [4], [1, 2], [3, 4]]
    assert {f.code for f in findings} == {"bogie-pressure"}


@pytest.mark.parametrize(
    "pressures",
    [
        ["BCU1.BCP [bar]", "BCU2.BCP [bar]"],
        ["Car 1 BCP [bar]", "Car 2 BCP [bar]"],
        ["BCP M1/1 [bar]", "BCP M1/2 [bar]"],
        ["CW1_BCP_BOGIE1 [bar]", "CW2_BCP_BOGIE1 [bar]"],
    ],
)
def test_where_names_do_not_say_the_axles_the_answer_is_a_line_to_paste(
    pressures: list[str],
) -> None:
    signals = Signals([0.0, 1.0], {name: [0.0, 0.0] for name in [*pressures, *AXLES]})
    source = MemorySource(signals)
    with pytest.raises(UserError, match="which axles these pressures serve") as error:
        needed(source, ())
    mappings = settings.load(assignments=pasted(error.value.hint)).mappings
    chosen, _ = needed(source, mappings)
    of_pressures = [(m.title, m.axle) for m in chosen if m.meaning == "pressure"]
    first, second = pressures
    assert of_pressures == [(first, 1), (first, 2), (second, 3), (second, 4)]


@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["BCP bogie 1 [bar]", *AXLES], "bogie-pressure"),
        (["Car 1 BCP [bar]", "Car 2 BCP [bar]", *CARS], "axles-counted-on"),
        (["v0 [km/h]", "v1 [km/h]", "p0 [bar]", "p1 [bar]"], "axles-from-zero"),
        (["ED force bogie 1 [kN]", *AXLES], "force-spread"),
    ],
)
def test_a_hint_about_axles_names_the_channel_when_it_is_pasted(
    names: list[str], code: str
) -> None:
    source = MemorySource(Signals([0.0, 1.0], {name: [0.0, 0.0] for name in names}))
    finding = next(f for f in needed(source, ())[1] if f.code == code)
    mappings = settings.load(assignments=pasted(finding.hint or "")).mappings
    assert mappings[0].channel in names
    chosen, _ = needed(source, mappings)
    assert mappings[0].channel in {m.field.channel for m in chosen if m.mapping}


@pytest.mark.parametrize(
    "name",
    [
        "BC pressure (Butterworth 4, 10 Hz) [bar]",
        "BC pressure [bar+1]",
        "BC pressure [kPa] (res. 5)",
        "wheel speed [km/h] (resolution 0.1)",
        "CX23-R_3.BC pressure [bar]",
        "Druck (Tiefpass 2. Ordnung) [bar]",
        "MVB.0x1A4.BCP [bar]",
        "BCP (max 3.8 bar) [bar]",
        "BC pressure 24V [bar]",
        "p_C (V2.3) [bar]",
    ],
)
def test_numbers_of_filters_offsets_and_devices_are_no_axles(name: str) -> None:
    place = place_of(Field(name))
    assert (place.axle, place.bogie, place.part) == (None, None, "")


def test_cars_with_codes_are_told_apart_by_their_letters() -> None:
    speeds = [f"Car {car} axle {n} speed [km/h]" for car in ("DM1", "TC1") for n in (1, 2)]
    axles, _ = served([*speeds, "Car DM1 BCP [bar]", "Car TC1 BCP [bar]"])
    assert list(axles.values()) == [[1], [2], [3], [4], [1, 2], [3, 4]]


def test_a_blank_after_a_point_ends_no_topic() -> None:
    axles, _ = served(["C-Druck 1. DG [bar]", *AXLES])
    assert axles["C-Druck 1. DG [bar]"] == [1, 2]
