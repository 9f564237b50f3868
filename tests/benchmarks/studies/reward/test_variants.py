"""What the study varies."""

import pytest

from benchmarks.studies.reward.variants import VARIANTS


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_changes_the_default_and_nothing_unknown(name):
    changed = VARIANTS[name].settings() != VARIANTS["default"].settings() or VARIANTS[name].demonstrations != 64
    assert changed == (name != "default")
