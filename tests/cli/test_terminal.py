"""Tables on a terminal: nothing wider than it, nothing lost."""

from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.cli.terminal import findings, table
from adhesion_cli.core.finding import Finding

text = st.lists(st.text("abc_[]", min_size=1, max_size=30), max_size=6).map(" ".join)
figure = st.floats(-1e6, 1e6).map(lambda x: f"{x:.3f}")


@given(
    rows=st.lists(st.tuples(text, figure, figure, figure, text), min_size=1, max_size=4),
    names=st.tuples(*[st.sampled_from(["mass [kg]", "lag [s]", "a long name [N]"])] * 4),
    prose=st.booleans(),
    width=st.sampled_from([60, 80, 100]),
)
def test_a_table_fits_and_loses_nothing(rows, names, prose, width):
    header = ["channel", *names]
    shown = table(header, rows, prose=prose, width=width)
    if prose:  # a number has no break, and so a text at the right may be too wide
        assert max(map(len, shown.splitlines())) <= width
    for row in rows:
        for cell in row[1:4]:
            assert cell in shown.split()
    known = [c for row in (header, *rows) for c in "".join(row)]
    assert all(shown.count(c) >= known.count(c) for c in set(known) - {" "})


def test_a_table_with_room_is_one_line_a_row():
    assert table(["axle", "lag [s]"], [["1", "0.12"], ["2", "-"]], width=80) == (
        "axle  lag [s]\n----  -------\n1        0.12\n2           -"
    )


def test_findings_that_differ_are_not_called_the_same():
    def shown(*texts: str) -> str:
        return findings([Finding("code", "info", x, f"axle {i}") for i, x in enumerate(texts, 1)])

    assert shown(*["no value"] * 4).endswith("the same for axle 2, axle 3, axle 4")
    assert "also for axle 2, axle 3, axle 4, with their own" in shown("920 mm", *["915 mm"] * 3)
