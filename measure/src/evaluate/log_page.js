"use strict";
const frame = document.getElementById("scene");
const buttons = [...document.querySelectorAll("nav button[data-page]")];
const all = document.getElementById("all");
let shown = -1;
let playing = false;
function show(index) {
  shown = index;
  buttons.forEach((button, i) => button.classList.toggle("shown", i === index));
  frame.src = buttons[index].dataset.page;
}
function play(on) {
  playing = on;
  all.textContent = on ? "Stop" : "Play all";
  frame.contentWindow.postMessage(on ? "play" : "pause", "*");
}
buttons.forEach((button, index) => button.addEventListener("click", () => show(index)));
all.addEventListener("click", () => play(!playing));
addEventListener("message", (event) => {
  if (event.source !== frame.contentWindow || !playing) return;
  if (event.data === "ready") frame.contentWindow.postMessage("play", "*");
  if (event.data === "ended") show((shown + 1) % buttons.length);
});
if (buttons.length > 0) show(0);
