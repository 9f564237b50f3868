"""Without a terminal, progress is plain lines that say how far a stage is."""

from graphrl_jax.progress import Progress


def test_a_plain_line_says_the_steps_done_of_all(capsys):
    with Progress() as progress:
        progress.begin("pretraining", 3000)
        progress.advance(300, loss=0.00193)
        progress.advance(1200, loss=0.0002)
        progress.begin("training the policy", 5)
        progress.advance(2)
    lines = [line.partition("] ")[2] for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        "pretraining",
        "pretraining: 300 of 3,000  loss 0.00193",
        "pretraining: 1,500 of 3,000  loss 0.0002",
        "training the policy",
        "training the policy: 2 of 5",
    ]
