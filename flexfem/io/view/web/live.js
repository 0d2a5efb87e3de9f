// A run that goes on: asks the server for later states.

import { unpack } from "view/arrays.js";

/** Milliseconds between questions; the server decides how often there is something new. */
const PAUSE = 1000;

/** Show later states in a page until its server ends. */
export async function watch(page) {
  let version = page.scene.version;
  for (;;) {
    await new Promise((resolve) => setTimeout(resolve, PAUSE));
    if (document.hidden) continue;
    try {
      const state = await (await fetch("state")).json();
      if (state.version === version) continue;
      const bytes = new Uint8Array(await (await fetch("content")).arrayBuffer());
      const size = new DataView(bytes.buffer).getUint32(0, true);
      const scene = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
      version = scene.version;
      page.replace(await unpack(scene, bytes.subarray(4 + size)));
    } catch (error) {
      document.getElementById("status").textContent = `the server does not answer: ${error.message}`;
      await new Promise((resolve) => setTimeout(resolve, 5 * PAUSE));
    }
  }
}
