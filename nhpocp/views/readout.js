"use strict";
// The values of every curve under the pointer, or under the arrow keys, of the figures that come with their numbers.
(() => {
  const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

  const said = (value) => {
    if (value === null) return "–";
    const size = Math.abs(value), plain = size === 0 || (size >= 1e-3 && size < 1e5);
    const text = plain ? value.toPrecision(4) : value.toExponential(3);
    return text.replace(/e([+-])(\d+)/, (_, sign, digits) =>
      "·10" + (sign === "-" ? "⁻" : "") + [...digits].map((digit) => RAISED[digit]).join("")).replace("-", "−");
  };
  const placed = ([offset, factor, log], value) => offset + factor * (log ? Math.log10(value) : value);
  const unplaced = ([offset, factor, log], place) =>
    log ? 10 ** ((place - offset) / factor) : (place - offset) / factor;

  // the last index whose entry is not above x, or -1: at a jump that is the value after it
  const before = (xs, x) => {
    let low = 0, high = xs.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (xs[middle] <= x) low = middle + 1; else high = middle;
    }
    return low - 1;
  };
  const valueAt = (xs, ys, x, interpolate) => {
    const i = before(xs, x);
    if (i < 0) return null;
    if (xs[i] === x) return ys[i];
    if (!interpolate || i + 1 >= xs.length || ys[i] === null || ys[i + 1] === null) return null;
    return ys[i] + (ys[i + 1] - ys[i]) * (x - xs[i]) / (xs[i + 1] - xs[i]);
  };

  const follow = (plot, { abscissa, interpolate, xs, panels }) => {
    const svg = plot.querySelector("svg");
    const stops = [...new Set(xs.flat())].filter((x) => x !== null).sort((a, b) => a - b);
    if (!stops.length) return;
    const layer = svg.appendChild(document.createElementNS(svg.namespaceURI, "g"));
    const shape = (name, attributes) => {
      const made = layer.appendChild(document.createElementNS(svg.namespaceURI, name));
      for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
      return made;
    };
    layer.setAttribute("class", "cursor");
    const marks = panels.map(({ box, curves }) => ({
      line: shape("line", { y1: box[1], y2: box[3], stroke: "#1a1a1a", "stroke-width": 0.6 }),
      dots: curves.map(({ colour }) => shape("circle", { r: 2, fill: colour, stroke: "#fff", "stroke-width": 0.5 })),
    }));
    const board = plot.appendChild(document.createElement("div"));
    board.className = "readout";
    board.setAttribute("role", "status");
    plot.tabIndex = 0;
    plot.setAttribute("role", "group");
    plot.setAttribute("aria-label", "Values of the curves: left and right move the cursor, up and down change the panel");
    let panel = 0, stop = stops.length >> 1;

    const hide = () => { layer.setAttribute("visibility", "hidden"); board.hidden = true; };
    const row = (words) => {
      const made = board.appendChild(document.createElement("div"));
      made.textContent = words;
      return made;
    };
    const show = () => {
      const x = stops[stop], unit = panels[panel].unit;
      layer.setAttribute("visibility", "visible");
      board.hidden = false;
      board.replaceChildren();
      row(`${panels[panel].name} at ${abscissa} = ${x}`.replace("-", "−"));
      panels.forEach(({ box, curves, ...scales }, p) => {
        const place = placed(scales.x, x);
        for (const end of ["x1", "x2"]) marks[p].line.setAttribute(end, place);
        marks[p].line.setAttribute("display", place < box[0] - 0.1 || place > box[2] + 0.1 ? "none" : "inline");
        curves.forEach(({ name, colour, x: own, y }, c) => {
          const value = valueAt(xs[own], y, x, interpolate), dot = marks[p].dots[c];
          const height = value === null || (scales.y[2] && value <= 0) ? NaN : placed(scales.y, value);
          const seen = height >= box[1] - 0.1 && height <= box[3] + 0.1;
          dot.setAttribute("display", seen ? "inline" : "none");
          if (seen) { dot.setAttribute("cx", place); dot.setAttribute("cy", height); }
          if (p === panel) {
            row(`${name}: ${said(value)}${unit && value !== null ? " " + unit : ""}`).style.borderLeftColor = colour;
          }
        });
      });
      const frame = plot.getBoundingClientRect(), drawn = svg.getBoundingClientRect();
      const zoom = drawn.width / svg.viewBox.baseVal.width, top = panels[panel].box[1];
      const across = placed(panels[panel].x, x) * zoom + drawn.left - frame.left;
      const width = board.offsetWidth, right = across + 12, room = frame.width - width;
      const left = right > room && across > frame.width / 2 ? across - 12 - width : right;
      board.style.left = `${Math.max(0, Math.min(left, room))}px`;
      board.style.top = `${top * zoom + drawn.top - frame.top}px`;
    };

    plot.addEventListener("pointermove", (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const hit = panels.findIndex(({ box }) =>
        at.x >= box[0] - 3 && at.x <= box[2] + 3 && at.y >= box[1] - 3 && at.y <= box[3] + 3);
      if (hit < 0) return hide();
      const x = unplaced(panels[hit].x, at.x), i = before(stops, x);
      panel = hit;
      stop = i < 0 ? 0 : i + 1 < stops.length && stops[i + 1] - x < x - stops[i] ? i + 1 : i;
      show();
    });
    for (const leaving of ["pointerleave", "blur"]) plot.addEventListener(leaving, hide);
    addEventListener("resize", hide);
    plot.addEventListener("focus", () => plot.matches(":focus-visible") && show());
    plot.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.key === "Escape") return hide();
      const far = event.shiftKey ? 10 : 1, all = stops.length;
      const moves = { ArrowLeft: [-far, 0], ArrowRight: [far, 0], Home: [-all, 0], End: [all, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      if (!(event.key in moves)) return;
      stop = Math.min(Math.max(0, stop + moves[event.key][0]), all - 1);
      panel = Math.min(Math.max(0, panel + moves[event.key][1]), panels.length - 1);
      event.preventDefault();
      show();
    });
    hide();
  };

  for (const data of document.querySelectorAll(".plot > script")) follow(data.parentElement, JSON.parse(data.textContent));
})();
