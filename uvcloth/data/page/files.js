// Files of the page: beside it on the server, or inside it, deflated and as base64, where the page is one file.

/** The bytes of a file. Throws an Error with a sentence if it cannot be loaded. */
export async function bytesOf(name) {
  const inside = textInside(name);
  if (inside !== null) return inflated(Uint8Array.from(atob(inside), (letter) => letter.charCodeAt(0)));
  const answer = await fetch(name).catch(() => null);
  if (!answer?.ok) throw new Error(`it cannot be loaded${answer ? ` (${answer.status})` : ""}`);
  return answer.arrayBuffer();
}

/** The bytes that were deflated. */
export function inflated(bytes) {
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

/** A worker of worker.js, which is plain text where the page is one file. */
export function makeWorker() {
  const inside = textInside("worker.js");
  if (inside === null) return new Worker(new URL("worker.js", import.meta.url), { type: "module" });
  return new Worker(URL.createObjectURL(new Blob([atob(inside)], { type: "text/javascript" })));
}

function textInside(name) {
  return document.querySelector(`script[data-file="${CSS.escape(name)}"]`)?.textContent ?? null;
}
