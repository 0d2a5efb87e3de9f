// Unpacks three.js, names the modules of the page by an import map, and starts the page.
(async (nonce) => {
  const address = (text) => URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  try {
    const packed = Uint8Array.from(atob(document.getElementById("library").textContent), (c) => c.charCodeAt(0));
    const library = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const imports = { three: address(await new Response(library).text()) };
    for (const module of document.querySelectorAll("[data-module]")) {
      imports[module.dataset.module] = address(module.textContent);
    }
    const map = document.createElement("script");
    map.type = "importmap";
    map.nonce = nonce;
    map.textContent = JSON.stringify({ imports });
    document.head.append(map);
    const { start } = await import("view/main.js");
    await start();
    document.getElementById("message").remove();
  } catch (error) {
    console.error(error);
    const message = document.getElementById("message");
    message.classList.add("failed");
    message.textContent = `This page cannot be shown here.\n${error.message ?? error}`;
  }
})(document.currentScript.nonce);
