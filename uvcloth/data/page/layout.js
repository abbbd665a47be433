// Panes beside each other: where each is in a rectangle, so that a standing figure is as large as it can be.

const SHAPE = 0.55; // width of what is looked at, of its height
const GAP = 6; // pixels

/** Rectangles {left, top, width, height} of so many panes in a larger one, row by row. */
export function panesIn({ left, top, width, height }, count) {
  const sizes = Array.from({ length: count }, (_, index) => {
    const columns = index + 1, rows = Math.ceil(count / columns);
    const size = { columns, width: (width - GAP * (columns - 1)) / columns, height: (height - GAP * (rows - 1)) / rows };
    return { ...size, shown: Math.min(size.width / SHAPE, size.height) };
  });
  const best = sizes.reduce((a, b) => (b.shown > a.shown ? b : a));
  return Array.from({ length: count }, (_, index) => {
    const row = Math.floor(index / best.columns), column = index % best.columns;
    return { left: left + column * (best.width + GAP), top: top + row * (best.height + GAP), width: best.width, height: best.height };
  });
}
