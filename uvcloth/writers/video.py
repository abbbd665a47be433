"""Video files, MP4 (H.264) and animated GIF, picture after picture, through PyAV."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError

QUALITY = "18"
"""Constant rate factor of H.264: no visible loss."""


class Video:
    """A video under construction: `add` every picture, then `close`."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        import av

        self._rate = Fraction(fps).limit_denominator(1001)
        self._count = 0
        self._palette: Any = None
        if path.suffix.lower() == ".gif":
            self._container = av.open(str(path), "w", format="gif")
            stream = self._container.add_stream("gif", rate=self._rate)
            stream.pix_fmt = "pal8"
            self._palette = _palette_graph(size, self._rate)
        else:
            # The index in front lets a player begin before it has the whole file.
            options = {"movflags": "+faststart"}
            self._container = av.open(str(path), "w", format="mp4", options=options)
            stream = self._container.add_stream("h264", rate=self._rate, options={"crf": QUALITY})
            stream.pix_fmt = "yuv420p"
            stream.codec_context.thread_count = 1
        stream.width, stream.height = size
        self._stream: Any = stream

    def add(self, picture: np.ndarray) -> None:
        """Append a picture (height, width, 3) uint8. Raises OSError if the disk is full."""
        import av

        frame: Any = av.VideoFrame.from_ndarray(picture, "rgb24")
        frame.pts, frame.time_base = self._count, 1 / self._rate
        self._count += 1
        if self._palette is None:
            self._encode(frame)
        else:
            self._palette.push(frame)
            self._encode_quantized()

    def close(self) -> None:
        """Write the end of the file. Raises OSError if the disk is full."""
        if self._palette is not None:
            self._palette.push(None)
            self._encode_quantized()
        self._encode(None)
        self._container.close()

    def discard(self) -> None:
        """Close the file as it is."""
        try:
            self._container.close()
        except OSError:
            return

    def _encode(self, frame: Any) -> None:
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def _encode_quantized(self) -> None:
        from av.error import BlockingIOError, EOFError

        while True:
            try:
                frame = self._palette.pull()
            except (BlockingIOError, EOFError):
                return
            self._encode(frame)


def open_video(path: Path, size: tuple[int, int], fps: float) -> Video:
    """Start a video of pictures of a size (width, height), even numbers; the suffix chooses the format.

    Raises InputError if PyAV is not installed, and OSError if the file cannot be written.
    """
    try:
        return Video(path, size, fps)
    except ModuleNotFoundError as error:
        raise InputError(f"{path.name}: videos need PyAV: install uvcloth[video]") from error


def _palette_graph(size: tuple[int, int], rate: Fraction) -> Any:
    """A filter graph that reduces every picture to its own 256 colours."""
    import av

    graph: Any = av.filter.Graph()
    source = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base=1 / rate)
    split, palette = graph.add("split"), graph.add("palettegen", "stats_mode=single")
    use, sink = graph.add("paletteuse", "new=1:dither=bayer:bayer_scale=4"), graph.add("buffersink")
    source.link_to(split)
    split.link_to(palette, 0, 0)
    split.link_to(use, 1, 0)
    palette.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    return graph
