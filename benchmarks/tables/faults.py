"""The table of faults on purpose: what was done to runs, imports and physics, and what came of it."""

from collections.abc import Mapping, Sequence

from benchmarks.tables.cells import Result, of_result, table, where

_KINDS = {"train": "runs of `train`, killed", "sweep": "sweeps, killed"}
_DISKS = {"full": "runs on a disk that gets full", "read_only": "runs on a disk that becomes read-only"}


def faults_of(result: Result) -> str:
    """A row per kind of fault."""
    rows = [
        *(_killed(label, result["kills"][name]) for name, label in _KINDS.items()),
        *(_on_disks(label, result["disks"][name]) for name, label in _DISKS.items()),
        _fuzzed(result["fuzz"]),
        _stepped(result["physics"]),
    ]
    parts = ", ".join(f"{name} {where(result[name])}" for name in ("kills", "disks", "fuzz", "physics"))
    return table(["fault", "tries", "what came of it"], rows, f"Measured by part: {parts}.")


def _killed(label: str, found: Mapping) -> Sequence[str]:
    outcome = (
        f"{len(found['unexpected'])} unexpected endings; once resumed, results differ by at most "
        f"{found['largest_difference']:g} from those of a run that nothing happened to"
    )
    return [label, f"{len(found['moments_s'])} kills", outcome]


def _on_disks(label: str, found: Sequence[Mapping]) -> Sequence[str]:
    refused = sum(one["ended"] == "refused" for one in found)
    finished = sum(one["resumed"] == "finished" for one in found)
    most = max(one["difference"] for one in found)
    outcome = f"{refused} end with one sentence, {finished} finish once resumed; results differ by at most {most:g}"
    return [label, str(len(found)), outcome]


def _fuzzed(found: Mapping) -> Sequence[str]:
    counts = [count for batch in found["batches"] for count in batch["outcomes"].values()]
    total = {name: sum(count.get(name, 0) for count in counts) for name in ("imported", "refused", "wrong")}
    slowest = max(batch["slowest_s"] for batch in found["batches"])
    most = max(batch["peak_mib"] for batch in found["batches"])
    outcome = (
        f"{total['refused']:,} end with one sentence, {total['imported']:,} with sound boxes, {total['wrong']} "
        f"otherwise; at most {slowest:.1f} s each and {most} MiB in all"
    )
    return ["mutated recordings of 13 formats, imported", f"{found['inputs']:,}", outcome]


def _stepped(found: Mapping) -> Sequence[str]:
    steps = f"{found['steps'] / 1e6:.0f} million steps"
    return [f"random actions on {len(found['tasks'])} tasks", steps, f"{found['bad']} states that are not finite"]


faults_table = of_result("faults")(faults_of)
