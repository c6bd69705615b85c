// Unpacks the library and the figures, which stand in the page packed, and draws them.
"use strict";
(async () => {
  const unpacked = async (id) => {
    const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).text();
  };
  try {
    const library = document.createElement("script");
    library.textContent = await unpacked("library");
    document.head.append(library);
    const { doc, roots, root_ids } = JSON.parse(await unpacked("figures"));
    await Bokeh.embed.embed_items({ report: doc }, [{ docid: "report", roots, root_ids }]);
    document.documentElement.dataset.drawn = "yes";
  } catch (error) {
    document.body.classList.add("without-figures");
    console.error(error);
  }
})();

// A4 is narrower than most windows: the figures are scaled, as their own layout comes too late.
const PRINTED = 700; // width between the margins of A4 [px]
addEventListener("beforeprint", () => {
  for (const place of document.querySelectorAll(".figure")) {
    const drawn = place.firstElementChild;
    if (!drawn) continue;
    const { width, height } = drawn.getBoundingClientRect();
    const scale = Math.min(PRINTED / width, 1);
    drawn.style.cssText = `width:${width}px;transform:scale(${scale});transform-origin:0 0`;
    place.style.height = `${height * scale}px`;
  }
});
addEventListener("afterprint", () => {
  for (const place of document.querySelectorAll(".figure")) {
    place.style.height = "";
    if (place.firstElementChild) place.firstElementChild.style.cssText = "";
  }
});
