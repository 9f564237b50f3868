"""The README says what the committed result files say, and shows what there is."""

import re

from benchmarks import readme

TEXT = (readme.ROOT / "README.md").read_text()


def test_tables_are_those_of_the_result_files():
    assert readme.with_tables(TEXT) == TEXT


def test_pictures_and_linked_files_are_there():
    links = re.findall(r"\]\(([^)#:]+)\)", TEXT)
    assert links and not [link for link in links if not (readme.ROOT / link).exists()]
