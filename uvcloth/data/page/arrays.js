// Files of arrays, as uvcloth/writers/page_arrays.py writes them.
import { inflated } from "./files.js";

const KINDS = { int8: Int8Array, uint8: Uint8Array, uint16: Uint16Array, int32: Int32Array, float32: Float32Array };

/** The header of a file, and its arrays by name; numbers in half precision as Float32Array. */
export async function readArrays(bytes) {
  const content = await inflated(bytes), size = new DataView(content).getUint32(0, true);
  const { arrays: places, ...header } = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 4, size)));
  const arrays = Object.entries(places).map(([name, { kind, start, count }]) => {
    const from = 4 + size + start;
    return [name, kind === "float16" ? widened(new Uint16Array(content, from, count)) : new KINDS[kind](content, from, count)];
  });
  return { header, arrays: Object.fromEntries(arrays) };
}

function widened(halves) {
  return Float32Array.from(halves, (half) => {
    const sign = half & 0x8000 ? -1 : 1, exponent = (half >> 10) & 31, share = half & 1023;
    return sign * (exponent ? 2 ** (exponent - 15) * (1 + share / 1024) : 2 ** -24 * share);
  });
}
