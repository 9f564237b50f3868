"""The README says what the committed result files say."""

from benchmarks import readme


def test_tables_are_those_of_the_result_files():
    text = (readme.ROOT / "README.md").read_text()
    assert readme.with_tables(text) == text
