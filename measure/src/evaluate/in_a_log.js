"use strict";
(() => {
  const tell = (what) => parent !== window && parent.postMessage(what, "*");
  const page = () => window.lgsPage;
  let last = NaN;
  addEventListener("message", async (event) => {
    if (event.source !== parent || !["play", "pause"].includes(event.data)) return;
    const viewer = await page();
    last = NaN;
    viewer.play(event.data === "play");
  });
  page().then((viewer) => {
    tell("ready");
    const [first, end] = viewer.span;
    setInterval(() => {
      // Playing starts again at the first moment after the last one; a single moment is its own end.
      if (viewer.isPlaying && (viewer.time < last || first === end)) {
        viewer.play(false);
        tell("ended");
      }
      last = viewer.isPlaying ? viewer.time : NaN;
    }, 30);
  });
})();
