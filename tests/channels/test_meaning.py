import os
import subprocess
import sys

import pytest
from helpers.pasted import pasted
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.channels import rules
from adhesion_cli.channels.meaning import Mapping, understood
from adhesion_cli.core import units
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Meaning, Parameter
from adhesion_cli.formats.source import Field


def seen(
    *names: str | tuple[str, ...], mappings: tuple[Mapping, ...] = ()
) -> list[tuple[object, ...]]:
    fields = [Field(n) if isinstance(n, str) else Field(*n) for n in names]
    meant, _ = understood(fields, mappings)
    return [(m.meaning, m.axle, m.unit) for m in meant]


PRESSURE, WHEEL, TRAIN = "pressure", "wheel_speed", "train_speed"
PIPE, RESERVOIR, ED = "brake_pipe", "reservoir_pressure", "ed_force"


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("BC pressure [kPa]", "v_kmh"), [(PRESSURE, None, "kPa"), (WHEEL, None, "kmh")]),
        (
            ("制动缸压力(kPa)", "轮速(km/h)", "列车速度(km/h)"),
            [(PRESSURE, None, "kPa"), (WHEEL, None, "km/h"), (TRAIN, None, "km/h")],
        ),
        (
            ("C-Druck [bar]", "HL-Druck [bar]", "Radgeschw. [km/h]", "Geschwindigkeit [km/h]"),
            [
                (PRESSURE, None, "bar"), (PIPE, None, "bar"),
                (WHEEL, None, "km/h"), (TRAIN, None, "km/h"),
            ],
        ),
        (
            ("Bremszylinderdruck (bar)", "Raddrehzahl (1/min)", "Zuggeschwindigkeit (km/h)"),
            [(PRESSURE, None, "bar"), (WHEEL, None, "1/min"), (TRAIN, None, "km/h")],
        ),
        (
            ("bc_pressure_1", "axle2_speed", "train_speed [m/s]"),
            [(PRESSURE, 1, ""), (WHEEL, 2, ""), (TRAIN, None, "m/s")],
        ),
        (
            ("BCP1_bar", "AxleSpd1_kmh", "TrainSpd_kmh", "MRP_bar"),
            [(PRESSURE, 1, "bar"), (WHEEL, 1, "kmh"), (TRAIN, None, "kmh"),
             (RESERVOIR, None, "bar")],
        ),
        (
            ("一轴轮速(km/h)", "二轴制动缸压力(kPa)", "黏着力真值(N)"),
            [(WHEEL, 1, "km/h"), (PRESSURE, 2, "kPa"), ("truth", None, "N")],
        ),
        (
            ("K [kN]", "F_adhesion_true [N]", "F_adhesion_estimated [N]"),
            [("clamping_force", None, "kN"), ("truth", None, "N"), (None, None, "N")],
        ),
        (
            ("p [bar]", "v [km/h]", "omega [rad/s]"),
            [(PRESSURE, None, "bar"), (TRAIN, None, "km/h"), (WHEEL, None, "rad/s")],
        ),
        (
            ("Pression CF essieu 2 [bar]", "Pression conduite générale [bar]",
             "Vitesse de rotation roue 2 (tr/min)", "Vitesse du train (km/h)"),
            [
                (PRESSURE, 2, "bar"), (PIPE, None, "bar"),
                (WHEEL, 2, "tr/min"), (TRAIN, None, "km/h"),
            ],
        ),
        (
            ("Pressione cilindro freno 1 [bar]", "Pressione condotta generale [bar]",
             "Velocità asse 1 [giri/min]", "Velocità treno [km/h]"),
            [
                (PRESSURE, 1, "bar"), (PIPE, None, "bar"),
                (WHEEL, 1, "giri/min"), (TRAIN, None, "km/h"),
            ],
        ),
        (
            ("Remcilinderdruk as 1 [bar]", "Treinleidingdruk [bar]",
             "Wielsnelheid as 1 [km/u]", "Treinsnelheid [km/u]"),
            [
                (PRESSURE, 1, "bar"), (PIPE, None, "bar"),
                (WHEEL, 1, "km/u"), (TRAIN, None, "km/u"),
            ],
        ),
        (
            ("Presión cilindro de freno 1 [bar]", "Velocidad eje 1 [km/h]", "Velocidad tren [m/s]"),
            [(PRESSURE, 1, "bar"), (WHEEL, 1, "km/h"), (TRAIN, None, "m/s")],
        ),
        (
            ("制动缸压力_1轴_kPa", "轴速1_km/h", "列车管压力(kPa)", "GPS速度 (km/h)"),
            [
                (PRESSURE, 1, "kPa"), (WHEEL, 1, "km/h"),
                (PIPE, None, "kPa"), (TRAIN, None, "km/h"),
            ],
        ),
        (
            ("Hauptluftleitungsdruck [bar]", "Vorsteuerdruck [bar]", "Cdruck DG2 [bar]"),
            [(PIPE, None, "bar"), (None, None, "bar"), (PRESSURE, 3, "bar"), (PRESSURE, 4, "bar")],
        ),
        (
            ("BC1 [bar]", "Speed axle 1 [km/h]", "Längsbeschleunigung [m/s^2]", "acc y [g]"),
            [
                (PRESSURE, 1, "bar"), (WHEEL, 1, "km/h"),
                (TRAIN, None, "m/s^2"), (None, None, "g"),
            ],
        ),
        (
            ("车速 (km/h)", "加速度 (m/s²)", "axle 1 speed (km/h)", "deceleration demand [m/s2]"),
            [
                (TRAIN, None, "km/h"), (None, None, "m/s²"),
                (WHEEL, 1, "km/h"), (None, None, "m/s2"),
            ],
        ),
        (
            ("Pression [bar]", "Effort de freinage [kN]", "Consigne de vitesse [km/h]", "Vitesse"),
            [(PRESSURE, None, "bar"), (None, None, "kN"), (None, None, "km/h"), (WHEEL, None, "")],
        ),
    ],
)  # fmt: skip
def test_reads_the_names_of_csv_columns(names: tuple[str, ...], expected: list[object]) -> None:
    assert seen(*names) == expected


def test_the_reason_told_is_the_same_in_every_run() -> None:
    code = (
        "from adhesion_cli.channels.meaning import understood\n"
        "from adhesion_cli.formats.source import Field\n"
        "names = ['列车速度', '轴1轮速转速', '1轴制动缸压力', '机车车速']\n"
        "print([m.reason for m in understood([Field(n) for n in names], ())[0]])"
    )
    told = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True,
            env={**os.environ, "PYTHONHASHSEED": str(seed), "PYTHONUTF8": "1"},
        ).stdout
        for seed in range(4)
    }  # fmt: skip
    assert len(told) == 1
    assert "列车" in told.pop()


def test_reads_topics_fields_and_message_types() -> None:
    joint = "sensor_msgs/msg/JointState"
    fields = [
        Field("/joint_states", "velocity[1]", "axle_2", message_type=joint, encoding="cdr"),
        Field("/joint_states", "position[1]", "axle_2", message_type=joint, encoding="cdr"),
        Field("/brake/bc1", "fluid_pressure", message_type="sensor_msgs/msg/FluidPressure"),
        Field("/brake/bc1", "variance", message_type="sensor_msgs/msg/FluidPressure"),
    ]
    meant, _ = understood(fields, ())
    assert [(m.meaning, m.axle, m.unit) for m in meant] == [
        (WHEEL, 2, "rad/s"), (None, 2, ""), (PRESSURE, 1, "Pa"), (None, 1, ""),
    ]  # fmt: skip
    assert "by definition" in meant[0].reason


def test_reads_a_result_of_ours_but_not_its_estimates() -> None:
    fields = [
        Field("/axle/3/input", name, message_type="adhesion.AxleInput", encoding="protobuf")
        for name in ("brake_cylinder_pressure", "clamping_force", "wheel_speed", "train_speed")
    ]
    fields += [Field("/axle/3/truth", "force", message_type="adhesion.Truth")]
    fields += [Field(f"/axle/3/{t}", "force") for t in ("reference", "estimate/neso")]
    meant, findings = understood(fields, ())
    assert [m.meaning for m in meant] == [
        "pressure", "clamping_force", "wheel_speed", "train_speed", "truth", None, None,
    ]  # fmt: skip
    assert [m.unit for m in meant[:5]] == ["Pa", "N", "rad/s", "m/s", "N"]
    assert {m.axle for m in meant} == {3}
    assert not findings


def test_a_result_says_by_its_types_what_it_holds_whatever_its_topics_begin_with() -> None:
    prefix = "/wheel 7, reference of a true adhesion pipe"
    fields = [
        Field(f"{prefix}/axle/2/input", name, message_type="adhesion.AxleInput")
        for name in ("brake_cylinder_pressure", "clamping_force", "wheel_speed", "train_speed")
    ]
    fields += [Field(f"{prefix}/axle/2/truth", "force", message_type="adhesion.Truth")]
    fields += [Field(f"{prefix}/axle/2/truth", "slip", message_type="adhesion.Truth")]
    fields += [Field(f"{prefix}/axle/2/slip", "slip", message_type="adhesion.Slip")]
    meant, findings = understood(fields, ())
    assert [(m.meaning, m.axle, m.unit) for m in meant] == [
        ("pressure", 2, "Pa"), ("clamping_force", 2, "N"), (WHEEL, 2, "rad/s"), (TRAIN, 2, "m/s"),
        ("truth", 2, "N"), ("true_slip", 2, "-"), (None, 2, ""),
    ]  # fmt: skip
    assert not findings


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("adhesion trial clamping force [N]", "clamping_force"),
        ("/x.adhesion/axle/1/input.clamping_force [N]", "clamping_force"),
        ("K_true [N]", "clamping_force"),
        ("brake force for adhesion test [N]", None),
        ("actual brake force [kN]", None),
        ("true normal force [N]", None),
        ("/adhesion/axle 1/force [N]", None),
        ("/adhesion/axle 1/F [N]", None),
        ("adhesion rig load [N]", None),
        ("actual adhesion force [N]", "truth"),
        ("adhesion force axle 2 [kN]", "truth"),
        ("Kraftschluss 2 [kN]", "truth"),
        ("F_adh_1 [N]", "truth"),
        ("F_true [N]", "truth"),
        ("黏着力(N)", "truth"),
    ],
)
def test_only_a_force_that_is_called_adhesion_or_true_is_the_truth(
    name: str, meaning: str | None
) -> None:
    ((found, _, _),) = seen(name)
    assert found == meaning


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("slip_true_1 [-]", "true_slip"), ("true slip axle 2 [%]", "true_slip"),
        ("滑移率真值 [%]", "true_slip"), ("slip_true_1", None), ("slip true [km/h]", None),
        ("slip_1 [-]", None), ("estimated true slip [-]", None), ("true slip sigma [-]", None),
    ],
)  # fmt: skip
def test_a_true_slip_says_so_and_has_a_unit(name: str, meaning: str | None) -> None:
    ((found, _, _),) = seen(name)
    assert found == meaning


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("Battery [V]", None), ("supply (mV)", None), ("Vbat_V", None), ("T1 [K]", "temperature"),
        ("set speed [km/h]", None), ("v_max [km/h]", None), ("speed error [km/h]", None),
        ("yaw rate [deg/s]", None), ("demanded cylinder pressure [bar]", None),
        ("wheel set 2 speed [km/h]", WHEEL), ("V_wheel 2 [km/h]", WHEEL), ("v [km/h]", TRAIN),
        ("Force (K) [kN]", "clamping_force"),
    ],
)  # fmt: skip
def test_what_only_shares_a_letter_or_a_unit_is_not_taken(name: str, meaning: str | None) -> None:
    wheel, found = seen("axle 1 speed [km/h]", name)
    assert (wheel[0], found[0]) == (WHEEL, meaning)


@pytest.mark.parametrize(
    ("name", "si"),
    [
        ("wheel_speed_rads", 1.0), ("wheel_speed_radps", 1.0), ("wheel_speed_kph", 1 / 3.6),
        ("wheel_speed_kmph", 1 / 3.6), ("wheel_speed_mps", 1.0), ("omega1_rads", 1.0),
        ("WheelSpeed_Rads", 1.0), ("axle2_speed_rads_2", 1.0), ("v_ax_1_kph", 1 / 3.6),
        ("axle1/speed_rads", 1.0),
    ],
)  # fmt: skip
def test_a_unit_at_the_end_of_a_name_is_taken(name: str, si: float) -> None:
    ((meaning, _, unit),) = seen(name)
    assert meaning == WHEEL
    assert units.stated_unit(str(unit), "wheel_speed", name).factor == pytest.approx(si)


@pytest.mark.parametrize(
    "name",
    [
        "BAT_V", "bat_v", "V_BAT", "VBat", "Vbat_V", "battery_v", "batt.v", "V_supply", "24V",
        "Battery Voltage 1", "V [V]", "V1 (mV)", "v [VDC]", "Spannung v", "电池 V",
    ],
)  # fmt: skip
def test_a_voltage_is_no_speed_by_its_letter(name: str) -> None:
    assert seen(name)[0][0] is None
    assert seen("v_wheel 1 [km/h]", name)[1][0] is None


def test_a_voltage_by_the_units_row_or_in_a_message_is_no_speed_by_its_letter() -> None:
    fields = [Field("V1", unit="V", unit_from="in the units row"), Field("/ecu", "bat_v")]
    assert [m.meaning for m in understood(fields, ())[0]] == [None, None]
    assert seen(("/battery", "wheel_speed_rads"))[0][0] == WHEEL


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("AxSpd1_kmh", WHEEL), ("v_Ax_1 [km/h]", WHEEL), ("BcPressAx1_bar", PRESSURE),
        ("Vref_kmh", TRAIN), ("VehSpd_kmh", TRAIN), ("vmax_kmh", None), ("GPS速度 [km/h]", TRAIN),
        ("Bremse 1 [bar]", PRESSURE), ("Brake pipe 1 [bar]", PIPE), ("Cil. freno [bar]", PRESSURE),
        ("副风缸压力 [kPa]", None), ("BC压力1 [kPa]", PRESSURE), ("ax [m/s2]", TRAIN),
    ],
)  # fmt: skip
def test_short_names_of_train_computers(name: str, meaning: str | None) -> None:
    assert seen(name)[0][0] == meaning


@pytest.mark.parametrize(
    ("name", "meaning", "axle"),
    [
        ("ED brake force per axle [kN]", ED, None), ("E-Bremse [kN]", ED, None),
        ("电制动力_2轴(kN)", ED, 2), ("EDB_Force_kN", ED, None), ("ED brake effort [%]", ED, None),
        ("Dynamic brake torque [Nm]", ED, None), ("F_ED [kN]", ED, None),
        ("Effort de freinage électrique [kN]", ED, None), ("Forza freno elettrico [kN]", ED, None),
        ("Esfuerzo eléctrico eje 2 [kN]", ED, 2), ("esfuerzo_freno_electrico_pct", ED, None),
        ("Fuerza freno eléctrico [kN]", ED, None), ("elektrodynamische rem [kN]", ED, None),
        ("ED brake force demand [kN]", None, None), ("ED brake torque motor 1 [Nm]", None, 1),
        ("brake force [kN]", None, None), ("制动力(kN)", None, None),
        ("ED brake active", None, None),
        ("Tractive/braking effort [kN]", "traction_force", None),
        ("Zug-/Bremskraft Achse 2 [kN]", "traction_force", 2),
        ("Esfuerzo tracción/freno [kN]", "traction_force", None),
        ("牵引力(kN)", "traction_force", None), ("Zugkraft [kN]", "traction_force", None),
        ("tractive effort [%]", "traction_force", None),
        ("BRAKEDEMAND_STEP1", "brake_command", None), ("brake demand [%]", "brake_command", None),
        ("WSP_Y_VV1_POP2", "vent_valve", 1), ("hold valve axle 3", "hold_valve", 3),
        ("防滑动作 1轴", "wsp_active", 1), ("WSP active", "wsp_active", None),
        ("Gleitschutz Entlüften Achse 2", "vent_valve", 2), ("WSP hold axle 3", "hold_valve", 3),
        ("GS-Ventil Achse 1", "wsp_active", 1), ("Gleitschutzventil 2", "wsp_active", None),
        ("GS Entlüften Achse 2", "vent_valve", 2), ("purge AE essieu 2", "vent_valve", 2),
        ("électrovanne AE essieu 1", "wsp_active", 1), ("anti-enrayeur actif", "wsp_active", None),
        ("AE1", None, 1), ("GS [m/s]", "wheel_speed", None),
        ("emergency brake", "emergency", None), ("Schnellbremsung", "emergency", None),
        ("Hauptbehälterleitung [bar]", RESERVOIR, None), ("总风压力(kPa)", RESERVOIR, None),
        ("BP [bar]", PIPE, None), ("Luftfederdruck [bar]", "load_pressure", None),
        ("撒砂", "sanding", None), ("MTB", "magnetic_brake", None),
        ("Mg-Bremse", "magnetic_brake", None), ("track brake active [-]", "magnetic_brake", None),
        ("Trackbrake", "magnetic_brake", None), ("track brake available [-]", None, None),
        ("Track brake distance [m]", "distance", None), ("track brake current [A]", None, None),
        ("Track brake test 3 [-]", None, None), ("track brake fault", None, None),
        ("sand level [-]", None, None), ("WSP slip axle 1 [-]", None, 1),
        ("ED force axle 1 %", ED, 1), ("Атмосферное давление [kPa]", None, None),
        ("Отметка [bar]", None, None), ("Относительная влажность", None, None),
        ("Давление ТМ [bar]", PIPE, None), ("가속도", None, None),
        ("열차 가속도 [m/s2]", TRAIN, None), ("Prędkość pociągu [km/h]", TRAIN, None),
        ("Schienenbremse", "magnetic_brake", None), ("brake force at the track [kN]", None, None),
        ("emergency brake [-]", "emergency", None), ("sanding [-]", "sanding", None),
        ("vent valve 2 [-]", "vent_valve", 2), ("emergency [%]", None, None),
        ("retarder torque [Nm]", "retarder", None),
        ("Distancia", "distance", None), ("distance [m]", "distance", None),
        ("里程(km)", "position", None), ("latitude [deg]", "latitude", None),
        ("GPS longitude", "longitude", None), ("gradient [‰]", "gradient", None),
        ("disc temperature axle 1 [°C]", "temperature", 1), ("v_lat [m/s]", None, None),
    ],
)  # fmt: skip
def test_other_channels_of_a_brake_test(name: str, meaning: str | None, axle: int | None) -> None:
    assert seen(name)[0][:2] == (meaning, axle)


def test_channels_that_no_analysis_takes_are_never_ambiguous() -> None:
    fields = [Field("temperature 1 [°C]"), Field("temperature 2 [°C]"), Field("temperature 0 [°C]")]
    meant, findings = understood(fields, ())
    assert [m.meaning for m in meant] == 3 * ["temperature"]
    assert findings == []


def test_each_rule_asks_for_words_that_the_vocabulary_has() -> None:
    asked = {kind for rule in rules.RULES for _, kinds in rules._conditions(rule.pattern)
             for kind in kinds}  # fmt: skip
    asked = {kind.removeprefix("own ") for kind in asked} - {*rules._SPECIAL, *rules._PAIRS}
    asked |= {kind for pairs in rules._PAIRS.values() for pair in pairs for kind in pair}
    assert asked <= {*rules._WORDS_BY_KIND}
    asked_of = {of for may_be in rules._QUANTITY.values() for of in may_be}
    derived = {"any", "absolute pressure", "speed without unit", "state", "switch"}
    assert {q for r in rules.RULES for q in r.quantity.split("|")} <= asked_of | derived


def test_a_folder_of_topics_called_adhesion_makes_no_truth() -> None:
    fields = ("clamping_force", "bc_pressure", "wheel_speed", "force")
    meant = [seen((f"/adhesion_rig/axle/1/{f}", "value"))[0][0] for f in fields]
    assert meant == ["clamping_force", PRESSURE, WHEEL, None]


def test_axles_counted_from_zero_move_up_and_are_told() -> None:
    fields = [Field(n) for n in ("p_bc_0 [bar]", "p_bc_1 [bar]", "omega_0 [rad/s]")]
    meant, findings = understood(fields, ())
    assert [m.axle for m in meant] == [1, 2, 1]
    assert [(f.code, f.count) for f in findings] == [("axles-from-zero", 3)]


def test_a_bogie_pressure_serves_both_axles() -> None:
    pressure, *speeds = map(Field, ("bogie2_bc_pressure_kPa", "axle3_speed_kmh", "axle4_speed_kmh"))
    meant, findings = understood([pressure, *speeds], ())
    assert {(m.meaning, m.axle) for m in meant} == {
        (PRESSURE, 3), (PRESSURE, 4), (WHEEL, 3), (WHEEL, 4)
    }  # fmt: skip
    (finding,) = findings
    assert (finding.code, finding.channel) == ("bogie-pressure", "bogie2_bc_pressure_kPa")
    assert finding.names["axles"] == "3 and 4"
    meant, findings = understood([pressure, speeds[0]], ())  # the other axle is not measured
    assert ([(m.meaning, m.axle) for m in meant], findings) == ([(PRESSURE, 3), (WHEEL, 3)], [])


@pytest.mark.parametrize(
    "remark",
    [
        "(WIKA S-20)",
        "~2 s avg",
        "(MA 5)",
        "LP10Hz",
        "cal. 2025-06",
        "(avg of 10)",
        "M12",
        "(HBM P3MB)",
    ],
)
def test_the_number_of_a_sensor_or_a_filter_is_no_axle(remark: str) -> None:
    names = (f"BC pressure {remark} [bar]", f"wheel speed {remark} [km/h]")
    for name in names:
        meant, _ = understood([Field(name)], ())
        assert [m.axle for m in meant] == [None]
    axles = [f"BCP {k} {remark} [bar]" for k in (1, 2)] + [f"v{k} {remark} [km/h]" for k in (1, 2)]
    assert [m.axle for m in understood([Field(x) for x in axles], ())[0]] == [1, 2, 1, 2]
    places = [Field(f"Druck HBM P{k} [bar]") for k in (3, 4)]  # nothing else tells them apart
    assert [m.axle for m in understood(places, ())[0]] == [3, 4]


@pytest.mark.parametrize(
    ("pressure", "speed"),
    [
        ("{}号車{}軸BC圧[kPa]", "{}号車速度{}軸[km/h]"),
        ("Wg{} RS{} C [bar]", "Wg{} RS{} v [km/h]"),
        ("Car {} BCP {} [bar]", "Car {} v{} [km/h]"), ("Veh{}/BCP_{} [bar]", "Veh{}/v_{} [km/h]"),
        ("DM{} BCP axle {} [bar]", "DM{} speed axle {} [km/h]"),
        ("B{}A{} BCP [bar]", "B{}A{}_v [km/h]"), ("BCP C1B{}A{} [bar]", "v C1B{}A{} [km/h]"),
        ("Fahrwerk {} Achse {} C-Druck [bar]", "Laufwerk {} Achse {} v [km/h]"),
        ("Bremsesylindertrykk boggi {} hjulsats {} [bar]", "fart v boggi {} hjulsats {} [km/h]"),
        ("Jarrusylinteripaine bog{}_axl{} [bar]", "v motor bogie {} axl{} [km/h]"),
    ],
)  # fmt: skip
def test_axles_of_each_car_are_counted_on(pressure: str, speed: str) -> None:
    places = [(car, axle) for car in (1, 2) for axle in (1, 2)]
    fields = [Field(x.format(*place)) for x in (pressure, speed) for place in places]
    meant, _ = understood(fields, ())
    assert [(m.meaning, m.axle) for m in meant] == [
        (x, k) for x in (PRESSURE, WHEEL) for k in (1, 2, 3, 4)
    ]


def test_axles_are_counted_on_over_a_motor_car_and_a_trailer() -> None:
    names = ("CF {} eje {} [bar]", "Velocidad {} eje {} [km/h]")
    fields = [Field(x.format(car, n)) for x in names for car in ("M1", "R2") for n in (1, 2)]
    meant, _ = understood(fields, ())
    assert [m.axle for m in meant] == [1, 2, 3, 4, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("BCP 1 model [bar]", None), ("mean BCP [bar]", None), ("BCP sum [bar]", None),
        ("BCP1-BCP2 [bar]", None), ("BCP 1 max [bar]", None), ("BCP 1 [mA]", None),
        ("v1 model [km/h]", None), ("v1 - v2 [km/h]", None), ("v1 [m]", "distance"),
        ("w1 [mm]", "distance"), ("slip 1 [km/h]", None), ("v1 filtered [km/h]", None),
        ("v ref axle 1 [km/h]", None),
        ("速度限制 [km/h]", None), ("Gear speed 1 [1/min]", None), ("P1 [kW]", None),
        ("Motordrehzahl 1 [1/min]", None), ("Pressure sensor temp 1 [°C]", "temperature"),
        ("GPS speed [km/h]", TRAIN),
    ],
)  # fmt: skip
def test_what_is_computed_or_another_quantity_gives_way(name: str, meaning: str | None) -> None:
    names = [f"BCP {k} [bar]" for k in (1, 2)] + [f"v axle {k} [km/h]" for k in (1, 2)]
    meant, findings = understood([Field(x) for x in (name, *names)], ())
    assert [m.axle for m in meant[1:] if m.meaning in (PRESSURE, WHEEL)] == [1, 2, 1, 2]
    assert (meant[0].meaning in (meaning, None), findings) == (True, [])


@pytest.mark.parametrize("other", ["BCP 1 model [bar]", "P1 [kW]", "AS pressure 1 [bar]"])
def test_numbers_of_other_channels_take_no_axles_away(other: str) -> None:
    for name in (
        "tlak BV{} [bar]",
        "C{} [bar]",
        "Brake pressure {} [bar]",
        "Bremsdruck Achse {} [bar]",
    ):
        if not (other[0] == "A" and name[0] in "tC"):  # these say no more than "AS pressure"
            meant, _ = understood([Field(x) for x in (other, *map(name.format, (1, 2)))], ())
            assert [m.axle for m in meant if m.meaning == PRESSURE] == [1, 2]


def test_the_mean_of_a_slow_log_is_taken_and_not_its_bounds() -> None:
    names = [f"BCP {k} {x} [bar]" for k in (1, 2) for x in ("min", "max", "avg")]
    meant, findings = understood([Field(x) for x in names], ())
    assert [m.meaning for m in meant] == 2 * [None, None, PRESSURE]
    assert not findings
    assert seen("n axle 1 [1/min]", "n axle 2 [1/min]", "n axle 3 [rpm]")[0][0] == WHEEL


def test_names_that_pandas_repeats_have_no_axles() -> None:
    meant, findings = understood([Field("BCP [bar]"), Field("BCP [bar].1")], ())
    assert [(m.meaning, m.axle) for m in meant] == [(PRESSURE, None), (None, None)]
    assert [f.code for f in findings] == ["channel-ambiguous"]


@pytest.mark.parametrize("name", ["Std BCP 1", "Oil pressure", "pantograph pressure", "Öl-Druck"])
def test_other_pressures_are_no_cylinder(name: str) -> None:
    assert understood([Field(f"{name} [bar]"), Field("p1 [bar]")], ())[0][0].meaning is None


@pytest.mark.parametrize("name", ["v", "v_Fzg", "v Lok", "SOG", "Tacho", "2D speed", "v_x"])
def test_a_speed_without_an_axle_among_those_of_axles_is_the_train_s(name: str) -> None:
    fields = [Field(f"{name} [km/h]"), *(Field(f"v{k} [km/h]") for k in (1, 2))]
    meant, findings = understood(fields, ())
    assert [(m.meaning, m.axle) for m in meant] == [(TRAIN, None), (WHEEL, 1), (WHEEL, 2)]
    assert not findings


@pytest.mark.parametrize("name", ["p", "p_T", "p_ER", "P CP", "Umgebungsdruck", "p_A"])
def test_a_pressure_without_an_axle_among_those_of_axles_is_another(name: str) -> None:
    others = [Field(f"{name} [bar]"), *(Field(f"p{k} [bar]") for k in (1, 2))]
    meant, findings = understood(others, ())
    assert [(m.meaning, m.axle) for m in meant] == [(None, None), (PRESSURE, 1), (PRESSURE, 2)]
    assert not findings


def test_german_letters_of_pressures() -> None:
    names = ("C1 [bar]", "C2 [bar]", "T-Druck [bar]", "Cv-Druck [bar]", "Vist [km/h]", "V1 [km/h]")
    meanings = [(m.meaning, m.axle) for m in understood([Field(x) for x in names], ())[0]]
    assert meanings == [
        (PRESSURE, 1), (PRESSURE, 2), (None, None), (None, None), ("train_speed", None), (WHEEL, 1)
    ]  # fmt: skip


def test_a_second_channel_for_the_same_thing_is_not_taken_in_silence() -> None:
    fields = [Field("wheel speed left [km/h]"), Field("wheel speed right [km/h]")]
    meant, findings = understood(fields, ())
    assert [m.meaning for m in meant] == [WHEEL, None]
    (finding,) = findings
    assert (finding.code, finding.severity, finding.count) == ("channel-ambiguous", "warning", 1)
    assert finding.channel == "wheel speed right [km/h]"
    assert (finding.names["first"], finding.names["meaning"]) == (
        "wheel speed left [km/h]",
        "wheel speed",
    )
    assert pasted(finding.hint) == ["channels.wheel_speed.channel=wheel speed right [km/h]"]


def test_second_sensors_of_all_axles_are_no_warning() -> None:
    names = [f"v axle {k} {side} [km/h]" for k in (1, 2) for side in ("sensor 1", "sensor 2")]
    assert {f.severity for f in understood([Field(x) for x in names], ())[1]} == {"info"}
    names = [f"v axle {k} {side} [km/h]" for k in (1, 2) for side in ("left", "right")]
    meant, findings = understood([Field(x) for x in names], ())
    assert [(m.meaning, m.axle) for m in meant][::2] == [(WHEEL, 1), (WHEEL, 2)]
    assert [(f.code, f.severity) for f in findings] == 2 * [("channel-ambiguous", "info")]
    cars = [Field(f"{car} v axle 1 [km/h]") for car in ("DMA", "DMB")]
    assert [f.severity for f in understood(cars, ())[1]] == ["warning"]


def test_a_lone_speed_beside_satellites_is_the_trains() -> None:
    names = ["sats", "velocity [km/h]", "BCP [bar]"]
    assert [m.meaning for m in understood([Field(x) for x in names], ())[0]] == [
        None, "train_speed", PRESSURE
    ]  # fmt: skip
    assert understood([Field(x) for x in names[1:]], ())[0][0].meaning == WHEEL
    names[1] = "wheel speed [km/h]"
    assert understood([Field(x) for x in names], ())[0][1].meaning == WHEEL


def test_many_channels_for_the_same_thing_are_one_finding() -> None:
    fields = [
        Field(f"wheel speed {'abcdefgh'[k // 8]}{'abcdefgh'[k % 8]} [km/h]") for k in range(60)
    ]
    (finding,) = understood(fields, ())[1]
    assert (finding.code, finding.count) == ("channel-ambiguous", 59)
    assert finding.channel.count(",") == 19


def test_a_mapping_beats_every_guess() -> None:
    mapping = Mapping("wheel_speed", 1, "x", unit="rpm")
    assert seen("x", "wheel speed [km/h]", mappings=(mapping,)) == [
        (WHEEL, 1, "rpm"), (None, None, "km/h"),
    ]  # fmt: skip


def test_a_mapping_to_a_missing_channel_names_the_nearest() -> None:
    with pytest.raises(UserError) as error:
        understood([Field("bc_pressure_1")], (Mapping("pressure", 1, "bc_presure_1"),))
    assert "bc_pressure_1" in error.value.hint


def test_a_mapping_to_one_of_several_fields_must_say_which() -> None:
    fields = [Field("/brake", "front"), Field("/brake", "rear")]
    with pytest.raises(UserError, match="several fields"):
        understood(fields, (Mapping("pressure", 1, "/brake", unit="bar"),))


def test_lists_in_lists_must_be_stated() -> None:
    paths = [f"bogies[{b}].wheel_speed_rpm[{w}]" for b in (0, 1) for w in (0, 1)]
    fields = [Field("/brake", path) for path in paths]
    assert [m.meaning for m in understood(fields, ())[0]] == [None] * 4
    stated = [Mapping("wheel_speed", k, "/brake", path) for k, path in enumerate(paths, 1)]
    assert [m.axle for m in understood(fields, stated)[0]] == [1, 2, 3, 4]


def test_a_column_name_used_twice_is_no_second_axle() -> None:
    fields = [Field("wheel speed [km/h]"), Field("wheel speed [km/h] (2)")]
    meant, findings = understood(fields, ())
    assert [(m.meaning, m.axle) for m in meant] == [(WHEEL, None), (None, None)]
    assert [f.code for f in findings] == ["channel-ambiguous"]


def test_a_topic_and_field_in_one_column_header() -> None:
    assert seen("/axle/1/input.train_speed [m/s]", "/axle/1/input.wheel_speed [rad/s]") == [
        (TRAIN, 1, "m/s"), (WHEEL, 1, "rad/s"),
    ]  # fmt: skip


def test_a_number_beside_the_train_is_no_axle() -> None:
    assert seen("Ch3 train speed [m/s]", "Ch7 wheel speed axle 2 [km/h]") == [
        (TRAIN, None, "m/s"), (WHEEL, 2, "km/h"),
    ]  # fmt: skip
    assert seen("Modul 12: BC pressure [bar]", "cDAQ1Mod2 Achse 3 speed [km/h]") == [
        (PRESSURE, None, "bar"), (WHEEL, 3, "km/h"),
    ]  # fmt: skip
    for device in ("QuantumX MX460B_2 CH 5:", "cDAQ2Mod3/ai7", "Slot 4"):
        assert seen(f"{device} wheel speed [km/h]") == [(WHEEL, None, "km/h")]
    assert seen("GPS speed [kn]", "clamping force [kn]") == [
        (TRAIN, None, "knots"), ("clamping_force", None, "kn"),
    ]  # fmt: skip
    meant, findings = understood([Field(f"Train speed {k} [km/h]") for k in (1, 2)], ())
    assert [(m.meaning, m.axle) for m in meant] == [(TRAIN, None), (None, None)]
    assert [f.code for f in findings] == ["channel-ambiguous"]


def test_a_pressure_that_the_name_calls_absolute() -> None:
    assert seen("brake cylinder pressure abs [kPa]") == [(PRESSURE, None, "kPa abs")]


@pytest.mark.parametrize(
    ("names", "axles"),
    [
        (("/axle1/pressure [bar]", "/axle2/pressure [bar]", "wheels.speed[0] [rpm]",
          "wheels.speed[1] [rpm]"), [1, 2, 1, 2]),
        (("p1 [bar]", "speed[0] [rpm]", "speed[1] [rpm]"), [1, 1, 2]),
        (("p1 [bar]", "p2 [bar]", "wheel speed 0 [rpm]", "wheel speed 1 [rpm]"), [1, 2, 1, 2]),
        (("p0 [bar]", "p1 [bar]", "p2 [bar]", "wheel speed 1 [rpm]"), [1, 2, 3, 2]),
        (("p0 [bar]", "p1 [bar]", ("/wheels", "speed[0]")), [1, 2, 1]),
    ],
)  # fmt: skip
def test_only_what_counts_axles_from_zero_moves_up(
    names: tuple[str | tuple[str, ...], ...], axles: list[int]
) -> None:
    assert [axle for _, axle, _ in seen(*names)] == axles


PARTS = st.one_of(
    st.sampled_from(
        "axle 轴 一轴 bogie BC speed [km/h] _V true K F [2] .1 ² 𐩀 ٣ (2) {0} g".split()
    ),
    st.text(max_size=4),
)
NAMES = st.lists(PARTS, max_size=5).map(" ".join)


@given(st.lists(st.tuples(NAMES, NAMES, NAMES, NAMES, NAMES), min_size=1, max_size=3))
def test_no_name_is_too_strange(names: list[tuple[str, ...]]) -> None:
    assert len(understood([Field(*n) for n in names], ())[0]) >= len(names)


def test_a_digit_of_no_decimal_number_is_no_axle() -> None:
    assert seen(("speed", "", "", "𐩀"))[0][1] is None


JSON_LISTS = [
    *(Field("/bcu", f"bc_press[{i}]", encoding="json") for i in range(4)),
    *(Field("/bcu", f"wheel_rpm[{i}]", encoding="json") for i in range(4)),
]


def test_a_list_without_an_index_is_an_element_for_each_axle() -> None:
    meant, _ = understood(JSON_LISTS, [Mapping(PRESSURE, None, "/bcu", "bc_press", "bar")])
    assert [(m.field.path, m.axle, m.unit) for m in meant if m.meaning == PRESSURE] == [
        (f"bc_press[{i}]", i + 1, "bar") for i in range(4)
    ]
    nested = [Field("/bcu", f"axles[{i}].p", encoding="json") for i in range(2)]
    meant, _ = understood(nested, [Mapping(PRESSURE, None, "/bcu", "axles.p", "bar")])
    assert [m.axle for m in meant] == [1, 2]


def test_a_unit_without_a_channel_is_that_of_every_guess() -> None:
    fields = [*JSON_LISTS, Field("/gnss", "speed_kmh", encoding="json")]
    meant, _ = understood(fields, [Mapping(PRESSURE, None, "", unit="bar")])
    assert [(m.meaning, m.axle, m.unit) for m in meant] == [
        *((PRESSURE, i + 1, "bar") for i in range(4)),
        *((WHEEL, i + 1, "rpm") for i in range(4)),
        (TRAIN, None, "kmh"),
    ]


def test_one_channel_may_be_stated_for_several_axles() -> None:
    meant, _ = understood([Field("p [bar]")], [Mapping(PRESSURE, n, "p") for n in (1, 2)])
    assert [(m.meaning, m.axle, m.unit) for m in meant] == [
        (PRESSURE, 1, "bar"),
        (PRESSURE, 2, "bar"),
    ]


def test_a_channel_stated_for_one_axle_leaves_the_others_theirs() -> None:
    names = [*(f"BCP {k} [bar]" for k in range(4)), *(f"wheel speed {k} [rpm]" for k in range(4))]
    fields = [Field(name) for name in names]
    swapped = [Mapping(PRESSURE, 3, names[3]), Mapping(PRESSURE, 4, names[2])]
    meant, findings = understood(fields, swapped)
    assert [(m.meaning, m.axle) for m in meant] == [
        *((PRESSURE, axle) for axle in (1, 2, 4, 3)),
        *((WHEEL, axle) for axle in (1, 2, 3, 4)),
    ]
    assert [(f.code, f.count) for f in findings] == [("axles-from-zero", 6)]
    meant, _ = understood(fields, [Mapping(PRESSURE, None, names[0])])
    assert [m.meaning for m in meant[:4]] == [PRESSURE, None, None, None]


def test_a_bogie_pressure_does_not_serve_an_axle_that_has_its_own() -> None:
    fields = [Field(x) for x in ("BCP bogie 1 [bar]", "sensor [bar]", "v 1 [rpm]", "v 2 [rpm]")]
    meant, findings = understood(fields, [Mapping(PRESSURE, 2, "sensor [bar]")])
    assert [(m.meaning, m.axle) for m in meant] == [
        (PRESSURE, 1), (PRESSURE, 2), (WHEEL, 1), (WHEEL, 2),
    ]  # fmt: skip
    assert not findings


def test_a_zero_is_that_of_the_channel_whose_name_says_the_axle() -> None:
    zero = Parameter(0.1, 0.01)
    names = Field("BCP 1 [bar]"), Field("BCP 2 [bar]")
    meant, _ = understood(names, [Mapping(PRESSURE, 2, "", zero=zero)])
    assert [m.zero for m in meant] == [None, zero]
    with pytest.raises(UserError, match=r"channels\.pressure\.axle3 names no channel") as error:
        understood(names, [Mapping(PRESSURE, 3, "", zero=zero)])
    assert pasted(error.value.hint) == ["channels.pressure.axle3.channel=BCP 2 [bar]"]


def test_the_index_of_a_list_is_no_unit() -> None:
    assert not units.unknown_in("bc_press[0]")
    assert units.unknown_in("bc_press[V]") == "V"


def test_a_channel_of_several_lists_is_refused_with_a_line_that_works() -> None:
    with pytest.raises(UserError, match="several fields") as error:
        understood(JSON_LISTS, [Mapping(PRESSURE, None, "/bcu", unit="bar")])
    key = "channels.pressure"
    assert pasted(error.value.hint) == [
        f"{key}.channel=/bcu",
        f"{key}.field=bc_press",
        f"{key}.unit=bar",
    ]


def test_numbers_of_ranges_filters_serials_and_series_are_no_axle() -> None:
    for name in (
        "BC pressure 0-10 bar", "BC pressure 10Hz LP [bar]", "BC pressure (ID 7) [bar]",
        "[0:1] BC pressure [bar]", "BC pressure:cDAQ9174Mod2/ctr0 [bar]",
        'bc_pressure_bar{job="train", instance="10.0.0.1:9100"}',
        "Channel1.Device1.BC_pressure_bar", "BC pressure 0..10 bar", "Run 12 BC pressure [bar]",
        "BC pressure avg 100 ms [bar]", "BC pressure 10bar sensor [bar]", "In1: BC pressure [bar]",
        "BC pressure (4-20 mA) [bar]", "BC pressure 2026-11-24 10:15 [bar]",
        "BC pressure 20 °C [bar]",
    ):  # fmt: skip
        assert seen(name) == [(PRESSURE, None, "bar")], name
    assert seen('v {axle="2", host="a1"} [km/h]') == [(WHEEL, 2, "km/h")]


def test_a_pressure_of_two_axles_is_that_of_their_bogie() -> None:
    speeds = [f"v{k} [km/h]" for k in (1, 2, 3, 4)]
    for pair in (
        "BCP {}/{} [bar]",
        "C-Druck {}/{} [bar]",
        "BC pressure axles {}-{} [bar]",
        "BCP {}+{} [bar]",
    ):
        read = seen(pair.format(1, 2), pair.format(3, 4), *speeds)
        assert sorted(axle or 0 for meaning, axle, _ in read if meaning == PRESSURE) == [1, 2, 3, 4]
    assert seen("BC pressure [bar] axles 1-4", *speeds)[0] == (PRESSURE, None, "bar")


def test_names_in_further_languages() -> None:
    for pressure, speed, pipe in (
        ("Tlak v brzdovém válci", "Rychlost kola", "Tlak v hlavním potrubí"),
        ("Fékhenger nyomás", "Keréksebesség", "Fővezeték nyomás"),
        ("Давление в тормозном цилиндре", "Скорость колеса", "Давление тормозной магистрали"),
        ("Ciśnienie w cylindrze", "Prędkość koła", "Ciśnienie w przewodzie głównym"),
        ("Fren silindiri basıncı", "Tekerlek hızı", "Ana boru basıncı"),
        ("Jarrusylinterin paine", "Pyörän nopeus", "Jarrujohdon paine"),
    ):
        assert seen(f"{pressure} [бар]", f"{speed} 2 [км/ч]", f"{pipe} [bar]") == [
            (PRESSURE, None, "бар"), (WHEEL, 2, "км/ч"), ("brake_pipe", None, "bar"),
        ]  # fmt: skip


def test_abbreviations_hold_in_their_language() -> None:
    names = "PG [bar]", "CH [bar]", "Prędkość koła 1 [km/h]"
    assert seen(*names) == [
        ("brake_pipe", None, "bar"), (PRESSURE, None, "bar"), (WHEEL, 1, "km/h"),
    ]  # fmt: skip
    axles = seen("CH1 [bar]", "CH 2 [bar]", "Predkosc kola 1 [km/h]", "Predkosc kola 2 [km/h]")
    assert axles[:2] == [(PRESSURE, 1, "bar"), (PRESSURE, 2, "bar")]
    assert seen("PG [bar]", "BC pressure [bar]", "wheel speed 1 [km/h]")[0] == (None, None, "bar")


@pytest.mark.parametrize(
    ("meaning", "names"),
    [
        (
            "brake_command",
            "Povel brzdy|Polecenie hamowania|Fékparancs|Comando freno|Mando de freno",
        ),
        ("brake_command", "Bromskommando|Comando de freio|Comandă frână|Príkaz brzdy|Rem commando"),
        ("magnetic_brake", "Kolejnicová brzda|Koľajnicová brzda|Hamulec szynowy|Sínfék|Railrem"),
        ("magnetic_brake", "Pattini|Freno de patín|Magnetskenbroms|Freio de patim|Frână cu patină"),
        (
            "sanding",
            "Pískování|Pieskovanie|Piaskowanie|Homokolás|Sandning|Areia|Nisipare|Sabbiatura",
        ),
        ("vent_valve", "Odpouštěcí ventil|Odvětrávací ventil|Odpúšťací ventil|Zawór upustowy"),
        ("vent_valve", "Ürítőszelep|Ontluchtingsventiel|Avluftningsventil|Válvula de alívio"),
        ("hold_valve", "Přídržný ventil|Zawór podtrzymujący|Tartószelep|Houdventiel|Hållventil"),
        (
            "emergency",
            "Rychlobrzda|Nouzové brzdění|Hamowanie nagłe|Vészfék|Nödbroms|Frână de urgență",
        ),
        ("wsp_active", "Protismyk|Protišmyk|Układ przeciwpoślizgowy|Csúszásgátló|Glidskydd"),
        ("reservoir_pressure", "Tlak vzduchojemu [bar]|Druk hoofdreservoir [bar]"),
        ("reservoir_pressure", "Przewód zasilający [bar]|Przewod zasilajacy [bar]"),
        ("brake_pipe", "Przewód główny [bar]|Przewod_glowny [bar]|vezetek nyomas [bar]"),
        ("brake_pipe", "TFA [bar]|Presión TFA [bar]|Conducto general [bar]"),
        ("retarder", "Ralentizador|Freno hidrodinámico"),
        ("wsp_active", "Antipatinaje"),
        ("brake_command", "Orden de freno"),
        ("reservoir_pressure", "TDP [bar]|Presión depósitos principales [bar]"),
        (
            "load_pressure",
            "Lastdruck [bar]|Presión de carga [bar]|Pression de charge [bar]",
        ),
        ("magnetic_brake", "Patín electromagnético|Patines activos|Patim magnético"),
        ("gradient", "Pochylenie [‰]|Sklon [‰]|Lutning [‰]"),
        (None, "Porucha pískování|Sanding fault|Fel sandning|Požadovaný tlak válce [bar]"),
    ],
)
def test_states_are_known_in_many_languages(meaning: Meaning | None, names: str) -> None:
    for name in names.split("|"):
        for channel in (name, f"{name} 2"):  # a valve's number is an axle's
            guess = rules.guess(Field(channel))
            assert guess.meaning == meaning, channel
            is_valve = channel != name and meaning in ("vent_valve", "hold_valve")
            assert guess.axle == (2 if is_valve else None) or not meaning, channel
