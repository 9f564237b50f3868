"""The table of faults."""

from benchmarks.tables import faults

ABOUT = {"device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.faults"}


def test_a_row_says_what_came_of_each_fault():
    killed = {"moments_s": [1.0, 2.0], "unexpected": [], "largest_difference": 0.0}
    disk = {"ended": "refused", "resumed": "finished", "difference": 0.0}
    outcomes = {"video": {"imported": 1, "refused": 1000}, "coco": {"refused": 2, "wrong": 1}}
    result = {
        "kills": {"train": killed, "sweep": killed | {"unexpected": ["torn"], "largest_difference": 0.5}, **ABOUT},
        "disks": {"full": [disk, disk | {"resumed": "failed"}], "read_only": [disk], **ABOUT},
        "fuzz": {"inputs": 1004, "batches": [{"outcomes": outcomes, "slowest_s": 1.23, "peak_mib": 600}], **ABOUT},
        "physics": {"tasks": {"a": {}, "b": {}}, "steps": 100_400_000, "bad": 3, **ABOUT},
    }
    lines = faults.faults_of(result).splitlines()
    assert "| 2 kills | 0 unexpected endings; once resumed, results differ by at most 0 from" in lines[2]
    assert "| 2 kills | 1 unexpected endings; once resumed, results differ by at most 0.5 from" in lines[3]
    assert "| 2 | 2 end with one sentence, 1 finish once resumed; results differ by at most 0 |" in lines[4]
    assert "| 1,004 | 1,002 end with one sentence, 1 with sound boxes, 1 otherwise; at most 1.2 s" in lines[6]
    assert lines[7] == "| random actions on 2 tasks | 100 million steps | 3 states that are not finite |"
