"""Rows of a table as they come."""

from pathlib import Path

from helpers.live_runs import lines_of, running


def test_empty_cells_of_slower_channels_are_one_note(tmp_path: Path) -> None:
    names = [f"{what} {n} [{unit}]" for n in (1, 2, 3, 4)
             for what, unit in (("bc_pressure", "bar"), ("wheel_speed", "km/h"))]  # fmt: skip
    rows = [
        [f"{0.01 * k:.2f}", *([f"{2.0 + 0.01 * (k % 7):.2f}" if k % 5 == 0 else "", "60.0"] * 4)]
        for k in range(200)
    ]
    text = "\n".join(",".join(row) for row in [["time [s]", *names], *rows]) + "\n"
    with running(tmp_path, "-", "--json", "-a", "td") as process:
        _, told = process.communicate(text, timeout=60)
    assert told.count("csv-missing-cells") == 1


def test_a_clock_in_digits_goes_on_over_the_minute(tmp_path: Path) -> None:
    times = [f"1015{59 + k // 50:02}.{k % 50 * 2:02}" for k in range(50)]
    times += [f"1016{k // 50:02}.{k % 50 * 2:02}" for k in range(100)]
    rows = "".join(f"{t},1.0,{80.0 - 0.01 * k:.2f}\n" for k, t in enumerate(times))
    text = "time [s],bc_pressure [bar],wheel_speed [km/h]\n" + rows
    with running(tmp_path, "-", "--json", "-a", "td") as process:
        out, told = process.communicate(text, timeout=60)
    said = [s["t"] for s in lines_of(out)]
    assert said == [round(101_559 + 0.02 * k, 2) for k in range(150)]
    assert "time-digits" in told


def test_times_are_exact_to_the_nanosecond(tmp_path: Path) -> None:
    times = ["1700000025.99", "1700000026.000000001", "1700000026.01", "1700000026.02"]
    rows = "".join(f"{t},1.0,{80.0 - 0.01 * k}\n" for k, t in enumerate(times))
    text = "time [s],bc_pressure [bar],wheel_speed [km/h]\n" + rows
    with running(tmp_path, "-", "--json", "-a", "td", "-a", "imm") as process:
        out, told = process.communicate(text, timeout=60)
    said = [line.split(",")[0].removeprefix('{"t": ') for line in out.splitlines()]
    assert said == [t for t in times for _ in range(2)], told
    assert [s["algo"] for s in lines_of(out)] == ["td", "imm"] * 4
