"""The ablations take out what is there. They run for minutes, so it would hardly be noticed if a part was renamed."""

from types import ModuleType

import pytest

from tests.benchmarks import ablation, motion_ablation, repair_ablation


@pytest.mark.parametrize("benchmark", [ablation, motion_ablation, repair_ablation])
def test_each_part_that_is_taken_out_exists(benchmark: ModuleType) -> None:
    changes = [change for taken_out in benchmark.WITHOUT.values() for change in taken_out]
    assert changes
    for owner, name, instead in changes:
        assert callable(getattr(owner, name)) == callable(instead), f"{owner.__name__}.{name}"
