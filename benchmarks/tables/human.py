"""Tables of human demonstrations: how well they are seen, and how near our task is to the one they come from."""

from benchmarks.tables.cells import Result, of_result, table, where

_ROWS = (
    ("share of whole replays that solve the task", "replays", "solved"),
    ("free motion, position: median", "free_motion", "position_median"),
    ("free motion, position: greatest", "free_motion", "position_max"),
    ("free motion, heading (rad): median", "free_motion", "heading_median"),
    ("free motion, heading (rad): greatest", "free_motion", "heading_max"),
)
_KINDS = ("carried", "dragged", "open", "all")


@of_result("human_video")
def human_table(result: Result) -> str:
    """How well recorded human demonstrations are seen."""
    overlaps = {
        "detector's boxes, overlap with the true ones": result["iou"],
        "boxes of our task for the recorded states": result["iou_of_our_tasks_boxes"],
    }
    speed = result["frames_per_second"]
    rows = [[label, *(f"{value:.3f}" for value in row.values())] for label, row in overlaps.items()]
    below = (
        f"{result['demonstrations']} demonstrations, {result['frames']} frames: {result['found']:.1%} of the objects "
        f"found, {result['identity_switches']} identity switches; with tracking {speed['one_core']:.0f} frames/s on "
        f"one core, {speed['all_cores']:.0f} on all {where(result)}"
    )
    return table(["", *(name.replace("_", " ") for name in result["iou"])], rows, below)


@of_result("magical_fidelity")
def fidelity_table(result: Result) -> str:
    """MAGICAL's actions in our task, beside what they did there."""
    variants = result["variants"]
    rows = [
        [label, *(f"{variant[section][measure]:.3f}" for variant in variants.values())]
        for label, section, measure in _ROWS
    ]
    for kind in _KINDS:
        errors = [variant["predictions"]["10_steps"][kind] for variant in variants.values()]
        cells = [f"{error['p50']:.3f} ({error['p90']:.3f})" for error in errors]
        rows.append([f"ten steps on, block {kind}: median (90 %)", *cells])
    rows.append(["seconds for the replays", *(f"{variant['replay_s']:.1f}" for variant in variants.values())])
    replays = variants["default"]["replays"]
    below = (
        f"Share of {replays['starts']} replays, their starts nudged by {replays['nudge']:g}, that solve the task; "
        f"MAGICAL's own, nudged by {replays['magical_itself']['nudge']:g}: {replays['magical_itself']['solved']:.2f} "
        f"{where(result)}"
    )
    return table(["recorded actions in our task: error", *variants], rows, below)
