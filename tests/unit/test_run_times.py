"""The summary of what Snakemake measured of the jobs."""

from velocal.io.run_times import RuleTimes, rule_times, write_summary

HEAD = "s\th:m:s\tmax_rss\tmean_load\tcpu_time\n"


def measured(folder):
    for name, seconds, memory, cpu in (
        ("adjust/sa1", "2.5", "310.25", "2.0"),
        ("adjust/sa2", "3.5", "290.0", "3.0"),
        ("table", "0.2", "NA", "-"),
    ):
        path = folder / f"{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{HEAD}{seconds}\t0:00:02\t{memory}\t80\t{cpu}\n")
    return folder


def test_jobs_of_a_rule_are_added_up(tmp_path):
    assert rule_times(measured(tmp_path)) == [
        RuleTimes("adjust", 2, 6.0, 5.0, 310.25),
        RuleTimes("table", 1, 0.2, 0.0, 0.0),
    ]


def test_files(tmp_path):
    write_summary(measured(tmp_path))
    rows = (tmp_path / "summary.csv").read_text().splitlines()
    assert rows == ["rule,jobs,wall_s,cpu_s,memory_mb", "adjust,2,6.0,5.0,310", "table,1,0.2,0.0,0"]
    lines = (tmp_path / "summary.md").read_text().splitlines()
    assert [cell.strip() for cell in lines[-1].split("|")][1:-1] == [
        "all",
        "3",
        "6.2",
        "5.0",
        "310",
    ]
    write_summary(tmp_path)
    assert (tmp_path / "summary.csv").read_text().splitlines() == rows


def test_without_measurements(tmp_path):
    write_summary(tmp_path / "no folder")
    assert not list(tmp_path.iterdir())
