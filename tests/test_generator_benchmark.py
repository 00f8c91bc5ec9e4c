"""What generated rows cost, on a few of them."""

from tests.benchmark_runs import read_table


def test_the_table_compares_generating_with_learning():
    lines = read_table("generator", "| work", ["--rows", "32", "--repeats", "2"]).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    assert [name.partition(",")[0] for name, *_ in rows] == [
        "the learner's update",
        "the generator's update",
        "decoding 32 rows",
        "judging 32 rows by three networks",
        "of that",
    ]
    assert rows[0][2] == "1.00"
    times = [float(milliseconds) for _, milliseconds, _ in rows]
    assert all(time > 0 for time in times)
    assert times[4] < times[3]
