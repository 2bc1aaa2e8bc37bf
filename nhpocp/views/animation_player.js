// The clock that moves scenes and panels together, and the controls that move the clock.
"use strict";

const data = JSON.parse(document.getElementById("animation-data").textContent);
const byId = (id) => document.getElementById(id);
const SECONDS = 6; // of a whole motion at speed 1
const START = { azimuth: (-62 * Math.PI) / 180, elevation: (20 * Math.PI) / 180, zoom: 1, shift: [0, 0] };
const camera = { ...START };
const scenes = [], views = [], frameTimes = [];
let time = 0, playing = false, last = null;

function place(times, t) { // where t lies among the samples
  if (t <= times[0]) return 0;
  let low = 0, high = times.length - 1;
  if (t >= times[high]) return high;
  while (high - low > 1) { const middle = (low + high) >> 1; if (times[middle] <= t) low = middle; else high = middle; }
  return low + (t - times[low]) / (times[high] - times[low]);
}

function frame() {
  const began = performance.now();
  data.runs.forEach((run, i) => scenes[i].draw(place(run.times, time)));
  for (const view of views) view.update(time);
  const unit = data.time_unit && ` ${data.time_unit}`;
  byId("clock").textContent = `t = ${time.toFixed(3)}${unit}`;
  const slider = byId("time");
  slider.value = String(time);
  slider.setAttribute("aria-valuetext", `t = ${time.toFixed(3)} of ${data.horizon}${unit}`);
  frameTimes.push(performance.now() - began);
  if (frameTimes.length > 2000) frameTimes.shift();
}

let asked = false;
function redraw() {
  if (asked || playing) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; frame(); });
}

function seek(t) { time = Math.min(Math.max(t, 0), data.horizon); frame(); }

function tick(now) {
  if (!playing) return;
  if (last !== null) time += ((now - last) / 1000) * (data.horizon / SECONDS) * parseFloat(byId("speed").value);
  last = now;
  const over = time >= data.horizon;
  if (over) { if (byId("loop").checked) time = 0; else time = data.horizon; }
  frame();
  if (over && !byId("loop").checked) pause(); else requestAnimationFrame(tick);
}

function play() {
  if (playing) return;
  if (time >= data.horizon) time = 0;
  playing = true;
  last = null;
  byId("play").textContent = "Pause";
  requestAnimationFrame(tick);
}

function pause() {
  playing = false;
  byId("play").textContent = "Play";
}

function turn(azimuth, elevation) {
  camera.azimuth += azimuth;
  camera.elevation = Math.min(Math.max(camera.elevation + elevation, -0.2), Math.PI / 2);
  redraw();
}

function shift(x, y) { camera.shift = add(camera.shift, [x, y]); redraw(); }

function zoom(factor) { camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.4), 8); redraw(); }

function steer(canvas) {
  const held = new Map();
  let spread = 0;
  canvas.addEventListener("pointerdown", (event) => { held.set(event.pointerId, event); canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const [x, y] = [event.clientX - before.clientX, event.clientY - before.clientY];
    if (held.size === 2) shift(x / 2, y / 2); else if (event.shiftKey || data.runs[0].low.length === 2) shift(x, y); else turn(-x / 150, y / 150);
    held.set(event.pointerId, event);
    if (held.size === 2) {
      const [p, q] = [...held.values()], now = Math.hypot(p.clientX - q.clientX, p.clientY - q.clientY);
      if (spread) zoom(now / spread);
      spread = now;
    }
  });
  const release = (event) => { held.delete(event.pointerId); spread = 0; };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("wheel", (event) => { // a page that is only scrolled by stays as it is
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 500));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [0.08, 0], ArrowRight: [-0.08, 0], ArrowUp: [0, 0.06], ArrowDown: [0, -0.06] };
    const zooms = { "+": 1.15, "=": 1.15, "-": 1 / 1.15 };
    if (turns[event.key] && event.shiftKey) shift(-250 * turns[event.key][0], -250 * turns[event.key][1]);
    else if (turns[event.key]) turn(...turns[event.key]); else if (zooms[event.key]) zoom(zooms[event.key]); else return;
    event.preventDefault();
    event.stopPropagation();
  });
}

function build() {
  const names = [...new Set(data.runs.flatMap((run) => run.panels.map((panel) => panel.name)))];
  const ranges = Object.fromEntries(names.map((name) => {
    const same = data.runs.flatMap((run) => run.panels.filter((panel) => panel.name === name));
    same.forEach((panel) => { panel.log = panel.log && same.every((other) => other.log); });
    return [name, commonRange(same)];
  }));
  data.runs.forEach((run, i) => {
    const canvas = byId(`scene-${i}`);
    scenes.push(new Scene(canvas, run, camera));
    steer(canvas);
    for (const panel of run.panels) {
      views.push(new PanelView(byId(panel.more ? `more-${i}` : `panels-${i}`), panel, ranges[panel.name], data.horizon, run.title));
    }
  });
  byId("play").addEventListener("click", () => (playing ? pause() : play()));
  byId("time").addEventListener("input", (event) => { pause(); seek(parseFloat(event.target.value)); });
  byId("nearer").addEventListener("click", () => zoom(1.25));
  byId("farther").addEventListener("click", () => zoom(0.8));
  byId("view").addEventListener("click", () => { Object.assign(camera, START); redraw(); });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|BUTTON|SUMMARY|A)$/.test(event.target.tagName)) return;
    const steps = { ArrowLeft: -0.01, ArrowRight: 0.01, PageUp: -0.1, PageDown: 0.1 };
    if (event.key === " " || event.key === "k") { if (playing) pause(); else play(); }
    else if (event.key === "Home") seek(0);
    else if (event.key === "End") seek(data.horizon);
    else if (steps[event.key]) { pause(); seek(time + steps[event.key] * data.horizon); }
    else return;
    event.preventDefault();
  });
  const again = () => { scenes.forEach((scene) => scene.resize()); views.forEach((view) => view.draw()); frame(); };
  window.addEventListener("resize", again);
  for (const more of document.querySelectorAll("details")) more.addEventListener("toggle", again);
  frame();
}

build();
// for tests and for those who script the page: positions on the canvas in pixels, times of frames in milliseconds
window.nhpocp = {
  data, frameTimes, seek, play, pause, turn, zoom,
  time: () => time,
  project: (run, point) => scenes[run].project(point),
  position: (run, name) => at(data.runs[run].parts.find((part) => part.name === name).values, place(data.runs[run].times, time)),
};
