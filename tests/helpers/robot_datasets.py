"""Small datasets of robots, written as LeRobot and robomimic write them."""

import io
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
from imageio_ffmpeg import write_frames
from PIL import Image
from pyarrow import parquet

SIZE = (48, 64)
"""Height and width of all pictures."""
FRAME_RATE = 10
LENGTHS = (4, 3, 5)
CAMERAS = ("observation.images.top", "observation.images.side")


def pictures(episode: int, length: int, camera: str = CAMERAS[0]) -> np.ndarray:
    """Frames (length, H, W, 3) uint8 of one colour each, which tells episode, frame and camera."""
    shade = 60 if camera == CAMERAS[0] else 200
    colours = [(40 + 60 * episode, 20 + 40 * frame, shade) for frame in range(length)]
    return np.stack([np.full((*SIZE, 3), colour, np.uint8) for colour in colours])


def are_pictures(frames: np.ndarray, episode: int, length: int, camera: str = CAMERAS[0]) -> bool:
    """Whether frames are those of `pictures`, but for compression."""
    expected = pictures(episode, length, camera)
    return frames.shape == expected.shape and np.abs(frames.astype(int) - expected).mean((1, 2, 3)).max() < 8


def write_mp4(path: Path, frames: np.ndarray, codec: str = "libx264", rate: float = FRAME_RATE) -> None:
    """Writes frames as a video whose index stands before its frames, so that a cut-off file can be opened."""
    path.parent.mkdir(parents=True, exist_ok=True)
    output = ["-movflags", "faststart", *(["-crf", "30", "-g", "2", "-cpu-used", "8"] if codec == "libaom-av1" else [])]
    size = (frames.shape[2], frames.shape[1])
    writer = write_frames(path, size, fps=rate, codec=codec, macro_block_size=1, quality=None, output_params=output)
    writer.send(None)
    for frame in frames:
        writer.send(np.ascontiguousarray(frame))
    writer.close()


def write_parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.Table.from_pylist(rows), path)


def edit_parquet(path: Path, row: int, **values: Any) -> None:
    """Changes values in a row; a value of None removes the column."""
    rows = parquet.read_table(path).to_pylist()
    rows[row].update({name: value for name, value in values.items() if value is not None})
    gone = [name for name, value in values.items() if value is None]
    write_parquet(path, [{name: value for name, value in one.items() if name not in gone} for one in rows])


def edit_info(folder: Path, **values: Any) -> None:
    """Changes fields of `meta/info.json`."""
    path = folder / "meta" / "info.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def _features(cameras: tuple[str, ...], dtype: str) -> dict[str, Any]:
    shown = {"dtype": dtype, "shape": [*SIZE, 3], "names": ["height", "width", "channels"]}
    return {
        "observation.state": {"dtype": "float32", "shape": [2], "names": None},
        "next.success": {"dtype": "bool", "shape": [1], "names": None},
        **{camera: shown for camera in cameras},
    }


def _info(
    folder: Path, version: str, lengths: tuple[int, ...], features: dict[str, Any], data: str, video: str
) -> None:
    content = {
        "codebase_version": version,
        "fps": FRAME_RATE,
        "features": features,
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "chunks_size": 1000,
        "data_path": data,
        "video_path": video,
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(content))


def png(frame: np.ndarray) -> dict[str, Any]:
    """A picture as a cell of a data file."""
    file = io.BytesIO()
    Image.fromarray(frame).save(file, "PNG")
    return {"bytes": file.getvalue(), "path": "frame.png"}


def _rows(episode: int, lengths: tuple[int, ...], images: tuple[str, ...]) -> list[dict[str, Any]]:
    """Rows of an episode; episode 1 fails."""
    length = lengths[episode]
    cells = {camera: [png(frame) for frame in pictures(episode, length, camera)] for camera in images}
    return [
        {
            "observation.state": [0.0, 1.0],
            "next.success": episode != 1 and frame == length - 1,
            "timestamp": float(np.float32(frame / FRAME_RATE)),
            "frame_index": frame,
            "episode_index": episode,
            "index": sum(lengths[:episode]) + frame,
            "task_index": 0,
            **{camera: cells[camera][frame] for camera in images},
        }
        for frame in range(length)
    ]


def write_lerobot_v30(
    folder: Path,
    lengths: tuple[int, ...] = LENGTHS,
    cameras: tuple[str, ...] = CAMERAS,
    codec: str = "libx264",
    dtype: str = "video",
    drift: float = 0.0,
) -> None:
    """A dataset of v3.0; the last episode has files of its own, those of the second camera begin with episode 1.

    Args:
      folder: its folder.
      lengths: frames of each episode.
      cameras: names of the cameras.
      codec: codec of the videos.
      dtype: "video", or "image" for pictures in the data files.
      drift: seconds by which each episode's times in a video are later than those of the one before.
    """
    data, video = (
        "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "{chunk_index:03d}/file-{file_index:03d}",
    )
    _info(folder, "v3.0", lengths, _features(cameras, dtype), data, f"videos/{{video_key}}/chunk-{video}.mp4")
    last = len(lengths) - 1
    rows, files, videos = [], {}, {}
    for episode, length in enumerate(lengths):
        first, file = sum(lengths[:episode]), int(0 < episode == last)
        row = {"episode_index": episode, "tasks": ["push"], "length": length, "stats/action/mean": [0.5]}
        row |= {"data/chunk_index": 0, "data/file_index": file}
        row |= {"dataset_from_index": first, "dataset_to_index": first + length}
        files.setdefault(file, []).extend(_rows(episode, lengths, cameras if dtype == "image" else ()))
        for camera in cameras if dtype == "video" else ():
            own = file if camera == CAMERAS[0] else int(episode > 0)
            before = videos.setdefault((camera, own), [])
            start = sum(map(len, before)) / FRAME_RATE + drift * episode
            before.append(pictures(episode, length, camera))
            row |= {f"videos/{camera}/chunk_index": 0, f"videos/{camera}/file_index": own}
            row |= {
                f"videos/{camera}/from_timestamp": start,
                f"videos/{camera}/to_timestamp": start + length / FRAME_RATE,
            }
        rows.append(row)
    for file, content in files.items():
        write_parquet(folder / f"data/chunk-000/file-{file:03d}.parquet", content)
    for (camera, file), frames in videos.items():
        write_mp4(folder / f"videos/{camera}/chunk-000/file-{file:03d}.mp4", np.concatenate(frames), codec)
    for file, content in enumerate((rows[:2], rows[2:])):
        if content:
            write_parquet(folder / f"meta/episodes/chunk-000/file-{file:03d}.parquet", content)
    write_parquet(folder / "meta" / "tasks.parquet", [{"task": "push", "task_index": 0}])


def write_lerobot_v21(folder: Path, lengths: tuple[int, ...] = LENGTHS, cameras: tuple[str, ...] = CAMERAS[:1]) -> None:
    """A dataset of v2.1, with two episodes in each chunk."""
    data = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    video = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
    _info(folder, "v2.1", lengths, _features(cameras, "video"), data, video)
    edit_info(folder, chunks_size=2, total_chunks=(len(lengths) + 1) // 2, total_videos=len(lengths) * len(cameras))
    for episode, length in enumerate(lengths):
        numbers = {"episode_chunk": episode // 2, "episode_index": episode}
        write_parquet(folder / data.format(**numbers), _rows(episode, lengths, ()))
        for camera in cameras:
            write_mp4(folder / video.format(**numbers, video_key=camera), pictures(episode, length, camera))
    # Backwards: lines are matched by their numbers.
    lines = [{"episode_index": index, "tasks": ["push"], "length": length} for index, length in enumerate(lengths)]
    (folder / "meta" / "episodes.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in reversed(lines)))


def write_robomimic(path: Path) -> None:
    """A file with demonstrations 0, 2 and 10 of 4, 3 and 5 frames, at 20 steps per second, seen by two cameras."""
    lengths = {0: 4, 2: 3, 10: 5}
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(lengths.values())
        data.attrs["env_args"] = json.dumps({"env_name": "Lift", "env_type": 1, "env_kwargs": {"control_freq": 20}})
        for number, length in lengths.items():
            demo = data.create_group(f"demo_{number}")
            demo.attrs["num_samples"] = length
            demo["actions"] = np.zeros((length, 7))
            demo["dones"] = np.zeros(length, int)
            for name, camera in (("agentview", CAMERAS[0]), ("wrist", CAMERAS[1])):
                demo[f"obs/{name}_image"] = pictures(number % 4, length, camera)
            demo["obs/robot0_eef_pos"] = np.zeros((length, 3))
        file["mask/train"] = np.array(["demo_0", "demo_2"], "S")
