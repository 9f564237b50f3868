"""A video as a GIF, for programs that show images but no videos. Plain Python."""

import subprocess
from pathlib import Path

from imageio_ffmpeg import get_ffmpeg_exe

LARGEST_WIDTH, FRAME_RATE = 480, 10
"""Pixels, and frames per second: a GIF is much larger than the video that it is made of."""


def as_gif(video: Path) -> bytes:
    """A video as an endless GIF of at most `LARGEST_WIDTH` pixels' width, at `FRAME_RATE` and the video's own speed.

    Raises:
      ValueError: the file is no video.
    """
    filters = f"fps={FRAME_RATE},scale='min({LARGEST_WIDTH},iw)':-1,split[a][b];[a]palettegen[p];[b][p]paletteuse"
    command = [get_ffmpeg_exe(), "-nostdin", "-loglevel", "error", "-i", video, "-vf", filters, "-f", "gif", "-"]
    made = subprocess.run(command, capture_output=True, check=False)
    if made.returncode:
        raise ValueError(f"{video} cannot be read as a video: {' '.join(made.stderr.decode(errors='replace').split())}")
    return made.stdout
