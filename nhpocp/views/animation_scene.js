// A small painter for mechanisms: parallel projection on a 2-D canvas, so it needs no graphics card and no library.
// Balls and bars are shaded as what they are, a circle and a strip, which under parallel projection is exact.
// What hides what: every flat body splits the rest into what lies before and behind its plane; the rest goes by depth.
"use strict";

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => { const n = norm(a) || 1; return a.map((x) => x / n); };
const mix = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));
const mean = (points) => points[0].map((_, i) => points.reduce((sum, p) => sum + p[i], 0) / points.length);
const lift = (p) => (p.length === 2 ? [p[0], p[1], 0] : p);

const shades = new Map();
function shade(colour, light) { // light -1 … 1: to black, to white
  const key = colour + light.toFixed(2);
  if (!shades.has(key)) {
    const full = parseFloat(light.toFixed(2)), goal = full > 0 ? 255 : 0, s = Math.abs(full);
    const grey = /^0?\.\d+$/.test(colour) ? Math.round(255 * parseFloat(colour)) : null;
    const rgb = grey === null ? [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16)) : [grey, grey, grey];
    shades.set(key, `rgb(${rgb.map((c) => Math.round(c + s * (goal - c))).join(",")})`);
  }
  return shades.get(key);
}

function niceStep(range, count) {
  const raw = range / count, power = Math.pow(10, Math.floor(Math.log10(raw)));
  return power * [1, 2, 5, 10].find((m) => m * power >= raw);
}

// Between two samples positions are interpolated; on a sample they are the trajectory's own.
function at(values, place) {
  if (values.length === 1) return values[0];
  const k = Math.min(Math.floor(place), values.length - 1), s = place - k;
  if (s < 1e-9 || k + 1 >= values.length || !values[k] || !values[k + 1]) return values[k];
  const between = (a, b) => (Array.isArray(a) ? a.map((x, i) => between(x, b[i])) : a + s * (b - a));
  return between(values[k], values[k + 1]);
}

class Scene {
  constructor(canvas, run, camera) {
    Object.assign(this, { canvas, run, camera, pen: canvas.getContext("2d") });
    this.flat = run.low.length === 2;
    this.low = lift(run.low);
    this.high = lift(run.high);
    this.middle = mix(this.low, this.high, 0.5);
    const half = add(this.high, this.middle, -1);
    this.round = Math.hypot(half[0], half[1]);
    this.half = half;
    this.resize();
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  look() {
    const { azimuth, elevation, zoom } = this.camera;
    const e = this.flat ? Math.PI / 2 : elevation, a = this.flat ? -Math.PI / 2 : azimuth;
    this.eye = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    this.right = [-Math.sin(a), Math.cos(a), 0];
    this.up = cross(this.eye, this.right);
    const wide = this.flat ? this.half[0] : this.round;
    const tall = this.flat ? this.half[1] : this.half[2] * Math.cos(e) + this.round * Math.abs(Math.sin(e));
    const [across, down] = this.flat ? [this.width - 74, this.height - 62] : [this.width - Math.min(90, 0.2 * this.width), this.height - 46];
    this.scale = zoom * Math.max(1e-3, Math.min(across / (2 * wide), down / (2 * tall)));
    this.rise = this.run.stretched ? (down * wide) / (across * tall) : 1; // numbers that are no places fill the plane
    if (this.run.stretched) this.scale = zoom * Math.max(1e-3, across / (2 * wide));
    this.origin = this.flat ? [this.width / 2 + 25, this.height / 2 - 18] : [this.width / 2, this.height / 2 - 2];
    this.origin = add(this.origin, this.camera.shift);
  }

  project(point) {
    const d = add(lift(point), this.middle, -1);
    return [this.origin[0] + this.scale * dot(d, this.right), this.origin[1] - this.scale * this.rise * dot(d, this.up)];
  }

  depth(point) { return this.flat ? 0 : dot(point, this.eye); } // in the plane what comes later lies on top

  draw(place) {
    const { pen } = this;
    this.look();
    pen.clearRect(0, 0, this.width, this.height);
    this.floor();
    const items = [];
    for (const ghost of this.run.ghosts) this.addGhost(items, ghost);
    if (this.run.trace) this.addTrace(items, place);
    const shown = this.run.parts.map((part) => [part, at(part.values, place)]).filter(([, value]) => value); // null: not finite
    this.balls = shown.filter(([part]) => part.kind === "ball").map(([part, v]) => ({ centre: v[0], radius: part.radius }));
    if (!this.flat) this.shadows(shown);
    for (const [part, value] of shown) {
      if (part.kind === "ball") this.addBall(items, part, value);
      else if (part.kind === "rod") this.addRod(items, part, value);
      else if (part.kind === "surface") this.addSurface(items, part, value);
      else if (part.kind === "points") for (const p of value) this.addPoint(items, lift(p));
      else this.addLine(items, value.map(lift), { colour: part.colour, width: part.width });
    }
    for (const item of this.ordered(items)) item.paint(pen);
    this.labels();
  }

  // --- what hides what ---

  ordered(items, left = 24) {
    const flat = left ? items.findIndex((item) => item.normal) : -1;
    if (flat < 0) return items.sort((a, b) => a.depth - b.depth);
    const wall = items[flat], side = Math.sign(dot(wall.normal, this.eye)) || 1, near = [], far = [];
    items.forEach((item, i) => {
      if (i === flat) return;
      const distance = side * dot(wall.normal, add(item.centre, wall.centre, -1));
      (distance > (item.normal ? 1e-9 : -1e-6) * this.round ? near : far).push(item);
    });
    return [...this.ordered(far, left - 1), wall, ...this.ordered(near, left - 1)];
  }

  put(items, centre, paint, normal) { items.push({ centre, depth: this.depth(centre), paint, normal }); }

  // --- parts ---

  trail(points, close) {
    const { pen } = this;
    pen.beginPath();
    points.forEach((p, i) => { const [x, y] = this.project(p); if (i) pen.lineTo(x, y); else pen.moveTo(x, y); });
    if (close) pen.closePath();
  }

  addLine(items, points, { colour, width, dash = [] }) {
    const pieces = [];
    if (points.length === 2) for (let i = 0; i < 6; i++) pieces.push([mix(...points, i / 6), mix(...points, (i + 1) / 6)]);
    else for (let i = 0; i + 1 < points.length; i += 6) pieces.push(points.slice(i, i + 7));
    for (const piece of pieces) {
      this.put(items, mean(piece), (pen) => {
        this.trail(piece);
        pen.strokeStyle = colour; pen.lineWidth = width; pen.lineCap = "round"; pen.lineJoin = "round";
        pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
      });
    }
  }

  addPoint(items, point) {
    this.put(items, add(point, this.eye, 0.02 * this.round), (pen) => {
      const [x, y] = this.project(point);
      pen.beginPath(); pen.arc(x, y, 3.2, 0, 7);
      pen.fillStyle = "#fff"; pen.fill(); pen.strokeStyle = "#222"; pen.lineWidth = 1.2; pen.stroke();
    });
  }

  addBall(items, part, [centre, ...axes]) {
    this.put(items, centre, (pen) => {
      const [x, y] = this.project(centre), r = part.radius * this.scale;
      const fill = pen.createRadialGradient(x - 0.35 * r, y - 0.4 * r, 0.1 * r, x, y, r);
      fill.addColorStop(0, shade(part.colour, 0.8)); fill.addColorStop(0.6, part.colour); fill.addColorStop(1, shade(part.colour, -0.3));
      pen.beginPath(); pen.arc(x, y, r, 0, 7); pen.fillStyle = fill; pen.fill();
      pen.strokeStyle = shade(part.colour, -0.55); pen.lineWidth = 0.8; pen.stroke();
      this.octant(pen, centre, axes, part.radius);
      axes.forEach((_, i) => this.meridian(pen, centre, axes[(i + 1) % 3], axes[(i + 2) % 3], part.radius));
    });
  }

  meridian(pen, centre, first, second, radius) {
    pen.beginPath();
    for (let k = 0, drawing = false; k <= 48; k++) {
      const angle = (k * Math.PI) / 24, way = add(first.map((x) => x * Math.cos(angle)), second, Math.sin(angle));
      const seen = dot(way, this.eye) > 0;
      const [x, y] = this.project(add(centre, way, radius));
      if (seen && drawing) pen.lineTo(x, y); else if (seen) pen.moveTo(x, y);
      drawing = seen;
    }
    pen.strokeStyle = "#5b6472"; pen.lineWidth = Math.min(1.3, 0.07 * radius * this.scale); pen.stroke();
  }

  octant(pen, centre, axes, radius) { // the part of the surface between the three axes, so that a turn is seen
    const n = radius * this.scale > 40 ? 8 : 4;
    const corner = (i, j) => add(centre, unit(add(add(axes[0].map((x) => x * (n - i - j)), axes[1], i), axes[2], j)), radius);
    pen.beginPath();
    for (let i = 0; i < n; i++) for (let j = 0; i + j < n; j++) {
      for (const tri of [[[i, j], [i + 1, j], [i, j + 1]], ...(i + j < n - 1 ? [[[i + 1, j], [i + 1, j + 1], [i, j + 1]]] : [])]) {
        const points = tri.map(([a, b]) => corner(a, b));
        if (dot(add(mean(points), centre, -1), this.eye) < 0) continue;
        points.forEach((p, k) => { const [x, y] = this.project(p); if (k) pen.lineTo(x, y); else pen.moveTo(x, y); });
        pen.closePath();
      }
    }
    pen.fillStyle = "#9aa5b8"; pen.fill(); pen.strokeStyle = "#9aa5b8"; pen.lineWidth = 0.6; pen.stroke();
  }

  addRod(items, part, [start, end]) {
    const along = unit(add(end, start, -1));
    const outside = (point, way) => { // a bar begins at the surface of the ball that it is fixed to
      for (const ball of this.balls) {
        if (norm(add(point, ball.centre, -1)) < 0.6 * ball.radius && part.radius < ball.radius) {
          return add(ball.centre, way, Math.sqrt(ball.radius ** 2 - part.radius ** 2) * 0.99);
        }
      }
      return point;
    };
    const from = outside(start, along), to = outside(end, along.map((x) => -x));
    if (dot(add(to, from, -1), along) <= 0) return;
    const total = norm(add(to, from, -1)), tube = part.tube ? Math.min(part.tube, total) : total;
    this.addCylinder(items, from, add(from, along, tube), part.radius, part.colour);
    if (part.tube) {
      this.addCylinder(items, add(from, along, tube), to, 0.52 * part.radius, "#c3c9d1");
      this.addCylinder(items, add(from, along, tube - 0.9 * part.radius), add(from, along, tube), 1.14 * part.radius, shadeHex(part.colour));
    }
  }

  addCylinder(items, from, to, radius, colour) {
    const length = norm(add(to, from, -1)), axis = unit(add(to, from, -1));
    if (length < 1e-9 * this.round) return;
    const count = Math.max(1, Math.min(8, Math.round(length / (0.16 * this.round))));
    for (let i = 0; i < count; i++) {
      const a = mix(from, to, i / count), b = mix(from, to, (i + 1) / count);
      this.put(items, mix(a, b, 0.5), (pen) => this.cylinder(pen, a, b, axis, radius, colour, i === 0, i === count - 1));
    }
  }

  cylinder(pen, a, b, axis, radius, colour, first, last) {
    const [ax, ay] = this.project(a), [bx, by] = this.project(b), r = radius * this.scale;
    const facing = dot(axis, this.eye), dx = dot(axis, this.right), dy = -dot(axis, this.up), seen = Math.hypot(dx, dy);
    const turn = Math.atan2(dy, dx), flat = Math.abs(facing) * r;
    const nx = seen > 1e-6 ? (-dy / seen) * r : r, ny = seen > 1e-6 ? (dx / seen) * r : 0;
    const fill = pen.createLinearGradient(ax - nx, ay - ny, ax + nx, ay + ny);
    const lit = -ny - nx * 0.6 < 0 ? 0.7 : 0.3; // light from above left
    fill.addColorStop(0, shade(colour, -0.35)); fill.addColorStop(lit, shade(colour, 0.45)); fill.addColorStop(1, shade(colour, -0.35));
    const cap = (x, y) => { pen.beginPath(); pen.ellipse(x, y, flat, r, turn, 0, 7); };
    const [near, far] = facing > 0 ? [[bx, by, last], [ax, ay, first]] : [[ax, ay, first], [bx, by, last]];
    pen.fillStyle = fill;
    cap(far[0], far[1]); pen.fill();
    if (far[2]) { pen.strokeStyle = shade(colour, -0.5); pen.lineWidth = 0.7; pen.stroke(); }
    pen.beginPath(); pen.moveTo(ax - nx, ay - ny); pen.lineTo(bx - nx, by - ny); pen.lineTo(bx + nx, by + ny); pen.lineTo(ax + nx, ay + ny); pen.closePath();
    pen.fill();
    pen.beginPath(); pen.moveTo(ax - nx, ay - ny); pen.lineTo(bx - nx, by - ny); pen.moveTo(ax + nx, ay + ny); pen.lineTo(bx + nx, by + ny);
    pen.strokeStyle = shade(colour, -0.5); pen.lineWidth = 0.7; pen.stroke();
    cap(near[0], near[1]);
    pen.fillStyle = near[2] ? shade(colour, 0.3) : fill; pen.fill();
    if (near[2]) pen.stroke();
  }

  addSurface(items, part, line) {
    const points = line.slice(0, -1).map(lift), centre = mean(points);
    if (this.flat) {
      this.put(items, centre, (pen) => this.fill(pen, points, shade(part.colour, 0.1), "#333"));
      return;
    }
    let normal = [0, 0, 0];
    points.forEach((p, i) => { normal = add(normal, cross(add(p, centre, -1), add(points[(i + 1) % points.length], centre, -1))); });
    const size = norm(normal);
    if (size < 1e-9 * this.round ** 2) { this.addLine(items, line.map(lift), { colour: part.colour, width: 4 }); return; }
    normal = normal.map((x) => x / size);
    if (points.some((p) => Math.abs(dot(normal, add(p, centre, -1))) > 1e-6 * this.round)) { // bent: a fan
      points.forEach((p, i) => {
        const corner = [p, points[(i + 1) % points.length], centre];
        this.put(items, mean(corner), (pen) => this.fill(pen, corner, part.colour, part.colour));
      });
      return;
    }
    const thick = 0.018 * this.round, lit = 0.12 + 0.3 * Math.abs(normal[2]);
    this.put(items, centre, (pen) => {
      const side = Math.sign(dot(normal, this.eye)) || 1;
      const top = points.map((p) => add(p, normal, 0.5 * side * thick)), bottom = points.map((p) => add(p, normal, -0.5 * side * thick));
      top.forEach((p, i) => {
        const next = (i + 1) % top.length, outward = cross(add(top[next], p, -1), normal.map((x) => x * side));
        const outside = dot(outward, add(mix(p, top[next], 0.5), centre, -1)) < 0 ? -1 : 1;
        if (outside * dot(outward, this.eye) > 0) this.fill(pen, [p, top[next], bottom[next], bottom[i]], shade(part.colour, -0.25), "#333");
      });
      this.fill(pen, top, shade(part.colour, lit - 0.15), "#333");
    }, normal);
  }

  fill(pen, points, colour, edge) {
    this.trail(points, true);
    pen.fillStyle = colour; pen.fill();
    pen.strokeStyle = edge; pen.lineWidth = 0.9; pen.lineJoin = "round"; pen.stroke();
  }

  addGhost(items, ghost) {
    const colour = ghost.words === "goal" ? "#0b5d1e" : "#4d4d4d";
    for (const outline of ghost.outlines) {
      const points = outline.map(lift), closed = points.length > 3 && norm(add(points[0], points[points.length - 1], -1)) < 1e-9 * this.round;
      if (closed) {
        const centre = mean(points.slice(0, -1));
        this.put(items, add(centre, this.eye, -1e-3 * this.round), (pen) => {
          this.trail(points, true);
          pen.globalAlpha = 0.1; pen.fillStyle = colour; pen.fill(); pen.globalAlpha = 1;
        });
      }
      this.addLine(items, points, { colour, width: 1.1, dash: [4, 3] });
    }
  }

  addTrace(items, place) {
    const points = this.run.trace.map(lift), here = at(this.run.trace, place), k = Math.floor(place);
    this.addLine(items, points, { colour: "#a3a3a3", width: 1.2 });
    this.addLine(items, [...points.slice(0, k + 1), lift(here)], { colour: "#111", width: 2 });
    for (const crossing of this.run.crossings) {
      if (!crossing.point) continue;
      const point = lift(crossing.point);
      this.put(items, add(point, this.eye, this.round), (pen) => {
        const [x, y] = this.project(point);
        pen.beginPath(); pen.moveTo(x, y - 6); pen.lineTo(x + 6, y); pen.lineTo(x, y + 6); pen.lineTo(x - 6, y); pen.closePath();
        pen.fillStyle = "#b2182b"; pen.fill(); pen.strokeStyle = "#fff"; pen.lineWidth = 1.2; pen.stroke();
      });
    }
  }

  // --- the room ---

  ticks(axis, count) {
    const step = niceStep(this.high[axis] - this.low[axis] || 1, count), levels = [];
    for (let v = Math.ceil(this.low[axis] / step - 1e-9) * step; v <= this.high[axis] + 1e-9 * step; v += step) levels.push(v);
    return levels.map((v) => [v, String(Number(v.toPrecision(6))).replace("-", "\u2212")]);
  }

  floor() {
    const { pen, low, high } = this;
    const level = this.flat ? 0 : low[2];
    pen.strokeStyle = "#e3e5e8"; pen.lineWidth = 1;
    const xs = this.ticks(0, 4), ys = this.ticks(1, 4);
    const line = (a, b) => { const p = this.project(a), q = this.project(b); pen.beginPath(); pen.moveTo(...p); pen.lineTo(...q); pen.stroke(); };
    for (const [x] of xs) line([x, low[1], level], [x, high[1], level]);
    for (const [y] of ys) line([low[0], y, level], [high[0], y, level]);
    const corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]].map((c) => [...c, level]);
    pen.strokeStyle = "#c9cdd3";
    corners.forEach((c, i) => line(c, corners[(i + 1) % 4]));
    const nearY = this.flat || this.eye[1] < 0 ? low[1] : high[1], nearX = this.flat ? low[0] : this.eye[0] > 0 ? high[0] : low[0];
    const name = (words, point, dx, dy) => {
      const [x, y] = this.project(point);
      pen.fillText(words, x + dx, y + dy);
    };
    pen.font = "12px 'STIX Two Text', 'Source Serif 4', Charter, Georgia, 'DejaVu Serif', serif";
    pen.fillStyle = "#4d4d4d"; pen.textAlign = "center"; pen.textBaseline = "middle";
    const out = 0.05 * this.round, [below, beside] = this.flat ? [0, 0] : [nearY === low[1] ? -out : out, nearX === high[0] ? out : -out];
    for (const [x, words] of xs) name(words, [x, nearY + below, level], 0, this.flat ? 12 : 8);
    for (const [y, words] of ys) name(words, [nearX + beside, y, level], this.flat ? -16 : (nearX === high[0] ? 8 : -8), this.flat ? 0 : 6);
    const [xn, yn, zn] = this.run.axes;
    name(xn, [this.middle[0], nearY + 3 * below, level], 0, this.flat ? 30 : 14);
    if (this.flat) {
      const [x, y] = this.project([nearX, this.middle[1], 0]);
      pen.save(); pen.translate(x - 44, y); pen.rotate(-Math.PI / 2); pen.fillText(yn, 0, 0); pen.restore();
      return;
    }
    name(yn, [nearX + 3 * beside, this.middle[1], level], nearX === high[0] ? 24 : -24, 18);
    if (this.eye[2] > 0.95) return; // from above the third axis is a point
    const edge = [nearX === high[0] ? low[0] : high[0], nearY];
    pen.strokeStyle = "#c9cdd3";
    line([...edge, low[2]], [...edge, high[2]]);
    const left = dot(add([...edge, 0], this.middle, -1), this.right) < 0 ? -1 : 1;
    for (const [z, words] of this.ticks(2, 4)) {
      const [x, y] = this.project([...edge, z]);
      pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + 4 * left, y); pen.stroke();
      pen.fillText(words, x + 16 * left, y);
    }
    name(zn, [...edge, high[2]], 0, -12);
  }

  shadows(shown) {
    const { pen } = this, level = this.low[2], fall = (p) => [p[0], p[1], level];
    pen.fillStyle = "#eff0f2"; pen.strokeStyle = "#eff0f2"; pen.lineCap = "butt";
    for (const [part, value] of shown) {
      if (part.kind === "surface") { this.trail(value.map((p) => fall(lift(p))), true); pen.fill(); }
      else if (part.kind === "rod") { this.trail(value.map(fall)); pen.lineWidth = Math.max(1, 1.6 * part.radius * this.scale * Math.abs(this.eye[2]) + 1); pen.stroke(); }
      else if (part.kind === "ball") {
        const [x, y] = this.project(fall(value[0])), r = part.radius * this.scale;
        pen.beginPath(); pen.ellipse(x, y, r, r * Math.abs(this.eye[2]), 0, 0, 7); pen.fill();
      }
    }
  }

  labels() { // on top of all: the names of the ghosts and of crossings
    const { pen } = this;
    pen.font = "italic 13px 'STIX Two Text', 'Source Serif 4', Charter, Georgia, 'DejaVu Serif', serif";
    pen.textBaseline = "middle"; pen.lineWidth = 3.5; pen.strokeStyle = "rgba(255,255,255,.9)"; pen.lineJoin = "round";
    const say = (words, x, y, colour, align) => { pen.textAlign = align; pen.strokeText(words, x, y); pen.fillStyle = colour; pen.fillText(words, x, y); };
    let before = null;
    for (const ghost of this.run.ghosts) {
      const spots = ghost.outlines.flat().map((p) => this.project(p));
      if (!spots.length) continue;
      const best = spots.reduce((a, b) => (b[0] > a[0] ? b : a));
      if (before && Math.hypot(best[0] - before[0], best[1] - before[1] - 10) < 16) best[1] = before[1] - 6;
      before = best;
      say(ghost.words, Math.min(best[0] + 7, this.width - 6 - pen.measureText(ghost.words).width), best[1] + (ghost.words === "goal" ? -4 : 6), ghost.words === "goal" ? "#0b5d1e" : "#4d4d4d", "left");
    }
    for (const crossing of this.run.crossings) {
      if (!crossing.point) continue;
      const [x, y] = this.project(crossing.point);
      say(`${crossing.words}, t = ${crossing.t.toFixed(3)}`, x - 11, y, "#9b1c1c", "right");
    }
  }
}

function shadeHex(colour) { return /^#/.test(colour) ? colour : "#555555"; }
