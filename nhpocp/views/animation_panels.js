// One quantity over time as SVG: curves drawn once, a cursor and dots that follow the clock.
"use strict";

function element(name, attributes, parent) {
  const made = document.createElementNS(document.querySelector("svg").namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (parent) parent.appendChild(made);
  return made;
}

function plain(value, range) { // a number for reading; rounding errors are zero
  if (value !== null && Math.abs(value) < 1e-10 * range) value = 0;
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value), digits = size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3;
  const words = size !== 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential(1) : value.toFixed(digits);
  return words.replaceAll("-", "\u2212");
}

function valueAt(curve, t) {
  const { t: times, y } = curve;
  if (t <= times[0]) return y[0];
  let low = 0, high = times.length - 1;
  if (t >= times[high]) return y[high];
  while (high - low > 1) { const middle = (low + high) >> 1; if (times[middle] <= t) low = middle; else high = middle; }
  if (y[low] === null || y[high] === null) return null;
  const width = times[high] - times[low];
  return width > 0 ? y[low] + ((t - times[low]) / width) * (y[high] - y[low]) : y[high];
}

class PanelView {
  constructor(parent, panel, range, horizon, owner) {
    Object.assign(this, { panel, range, horizon });
    const figure = document.createElement("figure");
    figure.className = "panel";
    parent.appendChild(figure);
    const caption = document.createElement("figcaption");
    caption.appendChild(document.createElement("b")).innerHTML = panel.title;
    figure.appendChild(caption);
    this.readings = panel.curves.map((curve) => {
      const entry = document.createElement("span");
      entry.className = "entry";
      entry.innerHTML = `<svg width="26" height="8" aria-hidden="true"><line x1="1" y1="4" x2="25" y2="4" stroke="${curve.colour}" stroke-width="2" stroke-dasharray="${curve.dash}"/></svg> ${curve.label} = <output></output>${curve.unit && ` ${curve.unit}`}`;
      caption.appendChild(entry);
      return entry.querySelector("output");
    });
    const words = `${panel.words} of ${owner} over time, ${panel.curves.length} curve${panel.curves.length > 1 ? "s" : ""}`;
    const marks = panel.marks.map((mark) => `${mark.words} at t = ${mark.t.toFixed(3)}`);
    this.svg = element("svg", { role: "img", "aria-label": [words, ...marks].join("; ") }, figure);
    this.draw();
  }

  draw() {
    this.svg.replaceChildren();
    const width = Math.max(this.svg.clientWidth, 180), height = this.svg.clientHeight || 120;
    const left = 48, right = width - 10, top = 6, bottom = height - 20;
    const { panel, horizon } = this, [low, high] = this.range;
    const level = panel.log ? (v) => Math.log10(v) : (v) => v, a = level(low), b = level(high);
    this.x = (t) => left + (t / horizon) * (right - left);
    this.y = (v) => bottom - ((level(v) - a) / (b - a)) * (bottom - top);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const words = (text, attributes) => { element("text", attributes, this.svg).textContent = text; };
    for (const v of this.levels(low, high)) {
      element("line", { x1: left, x2: right, y1: this.y(v), y2: this.y(v), class: v === 0 && panel.zero ? "zero" : "grid" }, this.svg);
      words(String(Number(v.toPrecision(6))).replace("-", "\u2212").replace("e-", "e\u2212"), { x: left - 6, y: this.y(v) + 4, "text-anchor": "end" });
    }
    const step = niceStep(horizon, 5);
    for (let t = 0; t <= horizon * (1 + 1e-9); t += step) {
      element("line", { x1: this.x(t), x2: this.x(t), y1: bottom, y2: bottom + 3, class: "axis" }, this.svg);
      words(String(Number(t.toPrecision(6))), { x: this.x(t), y: height - 4, "text-anchor": "middle" });
    }
    element("line", { x1: left, x2: right, y1: bottom, y2: bottom, class: "axis" }, this.svg);
    element("line", { x1: left, x2: left, y1: top, y2: bottom, class: "axis" }, this.svg);
    for (const mark of panel.marks) element("line", { x1: this.x(mark.t), x2: this.x(mark.t), y1: top, y2: bottom, class: mark.alarm ? "mark" : "grid" }, this.svg);
    for (const curve of panel.curves) element("path", { d: this.path(curve), class: "curve", stroke: curve.colour, "stroke-dasharray": curve.dash }, this.svg);
    this.cursor = element("line", { x1: 0, x2: 0, y1: top, y2: bottom, class: "cursor" }, this.svg);
    this.dots = panel.curves.map((curve) => element("circle", { r: 3, fill: curve.colour, class: "dot" }, this.svg));
  }

  levels(low, high) {
    const marks = [];
    if (this.panel.log) {
      for (let k = Math.ceil(Math.log10(low)); Math.pow(10, k) <= high; k++) marks.push(Math.pow(10, k));
      return marks.length > 1 ? marks : [low, high];
    }
    const step = niceStep(high - low, 4.5);
    for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) marks.push(Math.abs(v) < 1e-9 * step ? 0 : v);
    return marks;
  }

  path(curve) {
    let words = "", pen = false;
    curve.t.forEach((t, i) => {
      const y = curve.y[i], good = y !== null && (!this.panel.log || y > 0);
      if (good) words += `${pen ? "L" : "M"}${this.x(t).toFixed(1)} ${this.y(y).toFixed(1)}`;
      pen = good;
    });
    return words;
  }

  update(t) {
    const x = this.x(Math.min(t, this.horizon)).toFixed(1);
    this.cursor.setAttribute("transform", `translate(${x} 0)`);
    this.panel.curves.forEach((curve, i) => {
      const value = valueAt(curve, t), shown = value !== null && (!this.panel.log || value > 0);
      this.readings[i].textContent = plain(value, this.range[1] - this.range[0]);
      this.dots[i].setAttribute("transform", shown ? `translate(${x} ${this.y(value).toFixed(1)})` : "translate(-99 -99)");
    });
  }
}

// The same range for a quantity in all runs, so that they can be compared by eye.
function commonRange(panels) {
  const seen = panels.flatMap((panel) => panel.curves.flatMap((curve) => curve.y)).filter((v) => v !== null);
  if (panels[0].log) { const positive = seen.filter((v) => v > 0); return [0.8 * Math.min(...positive), 1.25 * Math.max(...positive)]; }
  let low = Math.min(...seen), high = Math.max(...seen);
  if (panels[0].zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
  const room = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [panels[0].zero && low === 0 ? 0 : low - room, panels[0].zero && high === 0 ? 0 : high + room];
}
