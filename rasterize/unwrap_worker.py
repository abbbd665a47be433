"""xatlas on one mesh, run as `python unwrap_worker.py` beside the program that asks.

Never imported: xatlas ends the process with some meshes (exact spheres of 40,000 vertices) and answers no
signal while it computes. Reads vertices (V, 3) float32, faces (F, 3) uint32 and the largest area of an
island, 0 for any, from standard input, and writes the vertex of each uv (U,), face_uvs (F, 3) and uvs (U, 2)
to standard output, as npy one after another.
"""

import io
import sys

import numpy as np
import xatlas


def main() -> None:
    """Unwrap."""
    stream = io.BytesIO(sys.stdin.buffer.read())
    vertices, faces, area = (np.load(stream) for _ in range(3))
    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices, faces)
    chart = xatlas.ChartOptions()
    chart.max_chart_area = float(area)
    pack = xatlas.PackOptions()
    pack.padding = 2
    pack.bilinear = True
    pack.resolution = 512
    pack.rotate_charts_to_axis = True
    atlas.generate(chart_options=chart, pack_options=pack)
    answer = io.BytesIO()
    for array in atlas[0]:
        np.save(answer, np.ascontiguousarray(array))
    # NumPy itself cannot write into a pipe, unless Python was told not to buffer it.
    sys.stdout.buffer.write(answer.getvalue())


main()
