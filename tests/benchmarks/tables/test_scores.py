"""The table of scores."""

from benchmarks.tables import scores


def test_recordings_are_counted_and_averaged_by_kind():
    def one(progress: float, success: bool) -> dict:
        orders = {"value_order_correlation": 0.5, "value_order_before_rest": 0.75}
        return {"final_progress": progress, "looks_like_success": success, **orders}

    about = {"device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.scores"}
    recordings = [{"recording": "both_1", **one(0.9, True)}, {"recording": "both_2", **one(0.8, False)}]
    seconds = {"import": 10.0, "pretrain": 60.0, "score": 30.0}
    human = {"demonstrations": [{"whole": one(1.0, True), "half": one(0.4, False)}], "folds": 5, **about}
    desk = {"recordings": recordings, "seconds": seconds, "scored_seconds": 110.0, **about}
    lines = scores.scores_of({"desk": desk, "human": human}).splitlines()
    assert lines[2:5] == [
        "| drawn: both jobs done | 2 | 1 | 0.850 | 0.500 | 0.750 |",
        "| human: whole | 1 | 1 | 1.000 | 0.500 | 0.750 |",
        "| human: cut off at half | 1 | 0 | 0.400 | 0.500 | 0.750 |",
    ]
