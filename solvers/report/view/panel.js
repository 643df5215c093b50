"use strict";
// -- one panel: axes with their canvas ------------------------------------------------------------------
class Panel {
  constructor(plot, index) {
    this.plot = plot;
    this.index = index;
    this.axes = plot.scene.axes[index];
    this.space = "zlim" in this.axes;
    this.pin = null;
    this.spot = null;
    this.home();
    const label = [...new Set(["xlabel", "ylabel", "zlabel"].map((key) => this.axes[key]).filter(Boolean))];
    this.name = label.map((text) => text.replace(/\n/g, " ")).reverse().join(" over ") || plot.scene.title;
    this.canvas = make("canvas");
    this.tip = make("div", { className: "tip", hidden: true });
    this.stage = make("div", { className: "stage", tabIndex: 0 }, this.canvas, this.tip);
    this.stage.setAttribute("role", "application");
    this.stage.setAttribute("aria-roledescription", "plot");
    this.stage.setAttribute("aria-label", `${this.name}. Arrows move, plus and minus zoom, 0 resets, full stop reads the next point.`);
    const tools = make("div", { className: "tools" });
    for (const [text, title, act] of [["+", "Zoom in", () => this.zoom(1.4)], ["−", "Zoom out", () => this.zoom(1 / 1.4)], ["⟲", "Reset the view", () => { this.home(); this.linked(); }]]) {
      const button = make("button", { type: "button", textContent: text, title, onclick: act });
      button.setAttribute("aria-label", `${title}: ${this.name}`);
      tools.append(button);
    }
    this.head = make("div", { className: "head" });
    for (const [text, colour] of this.axes.titles || []) {
      const note = make("span", { className: "note", textContent: text });
      note.dataset.colour = colour || "";
      this.head.append(note);
    }
    this.element = make("figure", { className: "panel" }, this.head, this.stage, tools);
    this.bars = plot.scene.bars.filter((bar) => bar.axes === index).map((bar) => {
      const canvas = make("canvas", { className: "bar" });
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Colours: ${bar.label}`);
      this.element.append(canvas);
      return [bar, canvas];
    });
    this.listen();
  }

  home() {
    const { xlim, ylim, zlim, elev, azim } = this.axes;
    Object.assign(this, { xlim: [...xlim], ylim: [...ylim], zlim, elev, azim, scale: 1, shift: [0, 0], moved: false });
  }

  // Values of a limit are logarithms on a logarithmic axis.
  forward(name, value) { return this.axes[`${name}log`] ? Math.log10(value) : value; }
  backward(name, value) { return this.axes[`${name}log`] ? 10 ** value : value; }

  measure(context) {
    const broad = this.canvas.clientWidth;
    const { axes } = this;
    context.font = "11px system-ui, sans-serif";
    if (this.space || axes.off) return { left: 4, top: 4, wide: broad - 8, high: this.tall - 8 };
    const bottom = (this.labels("x", 5).length ? 18 : 6) + (axes.xlabel ? 17 : 0);
    const high = this.tall - bottom - 8;
    const rows = this.labels("y", this.count("y", { high })).map(([, text]) => context.measureText(text).width);
    const lines = axes.ylabel ? axes.ylabel.split("\n").length : 0;
    const left = Math.max(10, ...rows.map((row) => row + 9)) + (lines ? 14 * lines + 4 : 0);
    return { left, top: 8, wide: broad - left - 14, high };
  }

  labels(name, count) {
    const fixed = this.axes[`${name}ticks`];
    if (fixed === 0) return [];
    if (fixed) return fixed;
    const [low, high] = this[`${name}lim`];
    const places = ticksOf(low, high, this.axes[`${name}log`], count);
    const step = places.length > 1 ? Math.abs(places[1] - places[0]) : 1;
    const digits = this.axes[`${name}log`] ? 3 : Math.max(4, Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / step)) + 2);
    return places.map((value) => [value, number(value, Math.min(digits, 12))]);
  }

  // Functions from data to pixels.
  mapping(box) {
    if (this.space) return this.perspective(box);
    const { left, top, wide, high } = box;
    const [x0, x1] = this.xlim.map((value) => this.forward("x", value));
    const [y0, y1] = this.ylim.map((value) => this.forward("y", value));
    const x = (value, space) => (value === null ? NaN : left + wide * (space === "y" || space === "a" ? value : (this.forward("x", value) - x0) / (x1 - x0)));
    const y = (value, space) => (value === null ? NaN : top + high * (1 - (space === "x" || space === "a" ? value : (this.forward("y", value) - y0) / (y1 - y0))));
    return {
      box,
      places: (artist) => artist.x.map((value, at) => [x(value, artist.k), y(artist.y[at], artist.k)]),
      flat: (line, space) => {
        const result = [];
        for (let i = 0; i < line.length; i += 2) result.push([x(line[i], space), y(line[i + 1], space)]);
        return result;
      },
      near: (px, py) => px > left - 6 && px < left + wide + 6 && py > top - 6 && py < top + high + 6,
      data: (px, py) => [this.backward("x", x0 + ((px - left) / wide) * (x1 - x0)), this.backward("y", y0 + (1 - (py - top) / high) * (y1 - y0))],
    };
  }

  perspective(box) {
    const { axes } = this;
    const limits = [axes.xlim, axes.ylim, axes.zlim];
    const sides = axes.sides;
    const project = (elev, azim) => {
      const [a, e] = [azim, elev].map((angle) => (angle * Math.PI) / 180);
      return (x, y, z) => {
        const [u, v, w] = [x, y, z].map((value, k) => (value === null ? NaN : ((value - limits[k][0]) / (limits[k][1] - limits[k][0]) - 0.5) * sides[k]));
        const ahead = Math.cos(a) * u + Math.sin(a) * v;
        const depth = Math.cos(e) * ahead + Math.sin(e) * w;
        const near = 1 / (1 - depth / 10);
        return [(Math.cos(a) * v - Math.sin(a) * u) * near, (Math.sin(e) * ahead - Math.cos(e) * w) * near, depth];
      };
    };
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => limits[axis][(k >> axis) & 1]));
    const seen = project(axes.elev, axes.azim);
    const ends = corners.map((corner) => seen(...corner));
    const spread = (k) => Math.max(...ends.map((end) => Math.abs(end[k])));
    const size = axes.off ? Math.min(box.wide, box.high) / (1.12 * Math.max(...sides))
      : Math.min((box.wide / 2 - 34) / spread(0), (box.high / 2 - 24) / spread(1));
    const look = project(this.elev, this.azim);
    const [middle, centre] = [box.left + box.wide / 2 + this.shift[0], box.top + box.high / 2 + this.shift[1]];
    const place = (x, y, z) => {
      const [u, v, depth] = look(x, y, z);
      return [middle + u * size * this.scale, centre + v * size * this.scale, depth];
    };
    const flat = (line) => {
      const result = [];
      for (let i = 0; i < line.length; i += 3) result.push(place(line[i], line[i + 1], line[i + 2]));
      return result;
    };
    return {
      box, place, flat, limits,
      places: (artist) => artist.x.map((value, at) => place(value, artist.y[at], artist.z ? artist.z[at] : limits[2][0])),
      depth: (line) => flat(line).reduce((sum, end) => sum + end[2], 0) / line.length,
      near: () => true,
    };
  }

  draw() {
    const context = this.canvas.getContext("2d");
    const broad = this.stage.clientWidth;
    if (!broad) return;
    const { size } = this.plot.scene;
    const [, , share, part] = this.axes.box;
    const ratio = (part * size[1]) / (share * size[0]);
    const wanted = this.space ? Math.min(Math.max(ratio, 0.7), 1) : ratio;
    this.tall = Math.round(Math.min(Math.max((broad - 60) * wanted + 46, 130), Math.max(300, 0.75 * innerHeight)));
    const ratioOfPixels = devicePixelRatio || 1;
    this.canvas.style.height = `${this.tall}px`;
    this.canvas.width = broad * ratioOfPixels;
    this.canvas.height = this.tall * ratioOfPixels;
    context.setTransform(ratioOfPixels, 0, 0, ratioOfPixels, 0, 0);
    const box = this.measure(context);
    if (this.axes.equal && !this.space) this.equalise(box);
    const map = this.mapping(box);
    this.map = map;
    if (this.space) this.drawBox(context, map); else this.drawGrid(context, box, map);
    const artists = this.plot.artists.filter((artist, at) => artist.a === this.index && artist.h !== 1 && !this.plot.hidden.has(at));
    artists.sort((a, b) => a.o - b.o);
    for (const artist of artists) {
      context.save();
      if (!this.space && artist.t !== "text") {
        const around = artist.m ? 6 : 1;
        context.beginPath();
        context.rect(box.left - around, box.top - around, box.wide + 2 * around, box.high + 2 * around);
        context.clip();
      }
      context.lineJoin = "round";
      drawArtist(context, artist, map, () => this.request());
      context.restore();
    }
    if (!this.space) this.drawFrame(context, box, map);
    if (this.pin) this.drawPin(context, map);
    if (this.spot) {
      context.strokeStyle = theme("--ink"); context.lineWidth = 1.5; context.setLineDash([]);
      const [[x, y]] = map.places(this.spot);
      context.beginPath(); context.arc(x, y, 6, 0, 7); context.stroke();
    }
    this.bars.forEach(([bar, canvas]) => this.drawBar(bar, canvas, broad));
    this.head.querySelectorAll(".note").forEach((note) => { note.style.color = tint(note.dataset.colour) || ""; });
  }

  request() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(); });
  }

  equalise(box) {
    const [x0, x1] = this.xlim;
    const [y0, y1] = this.ylim;
    const scale = Math.min(box.wide / Math.abs(x1 - x0), box.high / Math.abs(y1 - y0));
    const half = [box.wide / scale / 2, box.high / scale / 2];
    this.xlim = [(x0 + x1) / 2 - Math.sign(x1 - x0) * half[0], (x0 + x1) / 2 + Math.sign(x1 - x0) * half[0]];
    this.ylim = [(y0 + y1) / 2 - Math.sign(y1 - y0) * half[1], (y0 + y1) / 2 + Math.sign(y1 - y0) * half[1]];
  }

  drawGrid(context, box, map) {
    const { axes } = this;
    if (axes.off) return;
    context.strokeStyle = theme("--line"); context.globalAlpha = 0.55; context.lineWidth = 0.7; context.setLineDash([]);
    for (const [name, bit, count] of [["x", 1, this.count("x", box)], ["y", 2, this.count("y", box)]]) {
      if (!(axes.grid & bit)) continue;
      const places = axes[`${name}ticks`] ? axes[`${name}ticks`].map(([value]) => value) : ticksOf(...this[`${name}lim`], axes[`${name}log`], count);
      for (const value of places) {
        const [[x, y]] = map.places(name === "x" ? { x: [value], y: [0], k: "x" } : { x: [0], y: [value], k: "y" });
        if (!map.near(x, y)) continue;
        context.beginPath();
        if (name === "x") { context.moveTo(x, box.top); context.lineTo(x, box.top + box.high); } else { context.moveTo(box.left, y); context.lineTo(box.left + box.wide, y); }
        context.stroke();
      }
    }
    context.globalAlpha = 1;
  }

  count(name, box) { return name === "x" ? Math.max(2, Math.floor(box.wide / 75)) : Math.max(2, Math.floor(box.high / 38)); }

  drawFrame(context, box, map) {
    const { axes } = this;
    if (axes.off) return;
    const { left, top, wide, high } = box;
    context.strokeStyle = theme("--soft"); context.lineWidth = 1; context.setLineDash([]);
    for (const [side, from, to] of [["left", [left, top], [left, top + high]], ["right", [left + wide, top], [left + wide, top + high]], ["bottom", [left, top + high], [left + wide, top + high]], ["top", [left, top], [left + wide, top]]]) {
      if (!axes.frame.includes(side)) continue;
      context.beginPath(); context.moveTo(...from); context.lineTo(...to); context.stroke();
    }
    context.fillStyle = theme("--ink");
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center"; context.textBaseline = "top";
    let end = -Infinity;
    for (const [value, text] of this.labels("x", this.count("x", box))) {
      const [[x]] = map.places({ x: [value], y: [0], k: "x" });
      const half = context.measureText(text).width / 2;
      if (x < left - 2 || x > left + wide + 2 || Math.abs(x - end) < half + 4 || x - half < end + 4) continue;
      context.beginPath(); context.moveTo(x, top + high); context.lineTo(x, top + high + 3); context.stroke();
      context.fillText(text, x, top + high + 5);
      end = x + half;
    }
    context.textAlign = "right"; context.textBaseline = "middle";
    let last = Infinity;
    for (const [value, text] of this.labels("y", this.count("y", box))) {
      const [[, y]] = map.places({ x: [0], y: [value], k: "y" });
      if (y < top - 2 || y > top + high + 2 || Math.abs(last - y) < 11) continue;
      context.beginPath(); context.moveTo(left - 3, y); context.lineTo(left, y); context.stroke();
      context.fillText(text, left - 6, y);
      last = y;
    }
    context.font = "12px system-ui, sans-serif"; context.textAlign = "center";
    if (axes.xlabel) { context.textBaseline = "bottom"; context.fillText(axes.xlabel.replace(/\n/g, " "), left + wide / 2, this.tall - 1); }
    if (axes.ylabel) {
      context.save();
      context.translate(2, top + high / 2); context.rotate(-Math.PI / 2); context.textBaseline = "top";
      const lines = axes.ylabel.split("\n");
      const room = 2 * Math.min(top + high / 2, this.tall - top - high / 2);
      const least = Math.min(1, room / Math.max(...lines.map((line) => context.measureText(line).width)));
      context.font = `${Math.max(9, 12 * least)}px system-ui, sans-serif`;
      lines.forEach((line, at) => context.fillText(line, 0, 14 * at));
      context.restore();
    }
  }

  drawBox(context, map) {
    const { axes } = this;
    if (axes.off) return;
    const { limits, place } = map;
    const [a, e] = [this.azim, this.elev].map((angle) => (angle * Math.PI) / 180);
    const eye = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
    const back = eye.map((part, k) => limits[k][part > 0 ? 0 : 1]);
    const names = ["x", "y", "z"];
    context.setLineDash([]); context.font = "11px system-ui, sans-serif";
    const centre = place(...limits.map(([low, high]) => (low + high) / 2));
    const front = limits.map((limit, k) => limit[limit[0] === back[k] ? 1 : 0]);
    names.forEach((name, k) => {
      const [p, q] = [0, 1, 2].filter((other) => other !== k);
      const values = (axes[`${name}ticks`] || ticksOf(...limits[k], 0, 4).map((value) => [value, number(value)]));
      const at = (value, vp, vq) => { const spot = []; spot[k] = value; spot[p] = vp; spot[q] = vq; return place(...spot); };
      context.strokeStyle = theme("--line"); context.globalAlpha = 0.7; context.lineWidth = 0.8;
      for (const value of [...values.map(([tick]) => tick), ...limits[k]]) {
        context.beginPath();
        context.moveTo(...at(value, limits[p][0] === back[p] ? front[p] : limits[p][0], back[q]).slice(0, 2));
        context.lineTo(...at(value, back[p], back[q]).slice(0, 2));
        context.lineTo(...at(value, back[p], front[q]).slice(0, 2));
        context.stroke();
      }
      context.globalAlpha = 1;
      // The labels are at an edge that is not between two panes of the back.
      const edges = k === 2 ? [[front[0], back[1]], [back[0], front[1]]] : [[front[p], back[q]], [back[p], front[q]]];
      const mean = (pair) => at((limits[k][0] + limits[k][1]) / 2, ...pair);
      const floor = edges.sort((one, two) => (k === 2 ? mean(one)[0] - mean(two)[0] : mean(two)[1] - mean(one)[1]))[0];
      const spot = mean(floor);
      const away = [spot[0] - centre[0], spot[1] - centre[1]];
      const length = Math.hypot(...away) || 1;
      const out = k === 2 ? [-1, 0] : away.map((part) => part / length);
      context.fillStyle = theme("--ink"); context.textBaseline = "middle"; context.textAlign = k === 2 ? "right" : "center";
      for (const [value, text] of values) {
        const [x, y] = at(value, ...floor);
        context.fillText(text, x + out[0] * (k === 2 ? 5 : 13), y + out[1] * 11);
      }
      context.font = "12px system-ui, sans-serif"; context.textAlign = "center";
      const label = (axes[`${name}label`] || "").replace(/\n/g, " ");
      const width = context.measureText(label).width / 2;
      const x = Math.min(Math.max(spot[0] + out[0] * 36, width + 4), this.canvas.clientWidth - width - 4);
      if (k === 2) context.fillText(label, Math.max(width + 4, at(limits[2][1], ...floor)[0]), Math.max(8, at(limits[2][1], ...floor)[1] - 14));
      else context.fillText(label, x, Math.min(spot[1] + out[1] * 30, this.tall - 8));
      context.font = "11px system-ui, sans-serif";
    });
  }

  drawPin(context, map) {
    const { pin } = this;
    const [[px, py]] = map.places({ x: [pin.x], y: [pin.y], ...(pin.z === null ? {} : { z: [pin.z] }) });
    const { left, top, wide, high } = map.box;
    const [x, y] = [Math.min(Math.max(px, left), left + wide), Math.min(Math.max(py, top), top + high)];
    context.strokeStyle = theme("--bad"); context.lineWidth = 2.5; context.setLineDash([]);
    context.beginPath(); context.arc(x, y, 13, 0, 7); context.stroke();
    context.lineWidth = 1; context.setLineDash([4, 4]);
    context.beginPath();
    if (!this.space) { context.moveTo(left, y); context.lineTo(left + wide, y); }
    context.moveTo(x, top); context.lineTo(x, top + high); context.stroke();
  }

  drawBar(bar, canvas, broad) {
    const context = canvas.getContext("2d");
    const ratio = devicePixelRatio || 1;
    canvas.width = broad * ratio; canvas.height = 44 * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [left, wide] = [50, broad - 80];
    const step = wide / bar.colours.length;
    bar.colours.forEach((colour, at) => { context.fillStyle = bar.raw ? colour : tint(colour, true); context.fillRect(left + at * step, 2, step + 0.6, 9); });
    context.fillStyle = theme("--ink"); context.font = "11px system-ui, sans-serif"; context.textAlign = "center"; context.textBaseline = "top";
    let end = -Infinity;
    for (const [share, text] of bar.ticks) {
      const half = context.measureText(text).width / 2;
      if (left + share * wide - half < end + 6) continue;
      context.fillText(text, left + share * wide, 14);
      end = left + share * wide + half;
    }
    context.font = "12px system-ui, sans-serif";
    context.fillText(bar.label.replace(/\n/g, " "), left + wide / 2, 28);
  }

  // -- moving the view ------------------------------------------------------------------------------
  zoom(factor, at = null) {
    this.moved = true;
    if (this.space) this.scale *= factor;
    else {
      const shares = at ? [(at[0] - this.map.box.left) / this.map.box.wide, 1 - (at[1] - this.map.box.top) / this.map.box.high] : [0.5, 0.5];
      this.change((low, high, name) => {
        const middle = low + (name === "x" ? shares[0] : shares[1]) * (high - low);
        return [middle + (low - middle) / factor, middle + (high - middle) / factor];
      });
    }
    this.linked();
  }

  pan(x, y) {
    this.moved = true;
    if (this.space) { this.azim -= x * 0.4; this.elev = Math.min(90, Math.max(-90, this.elev + y * 0.4)); } else {
      this.change((low, high, name) => {
        const shift = name === "x" ? (-x / this.map.box.wide) * (high - low) : (y / this.map.box.high) * (high - low);
        return [low + shift, high + shift];
      });
    }
    this.linked();
  }

  change(move) {
    for (const name of ["x", "y"]) {
      const limits = this[`${name}lim`].map((value) => this.forward(name, value));
      this[`${name}lim`] = move(limits[0], limits[1], name).map((value) => this.backward(name, value));
    }
  }

  // Panels over the same interval, such as time, move together; so do the pictures of a comparison.
  linked() {
    this.stage.style.touchAction = this.moved ? "none" : "pan-y";
    for (const plot of plots) {
      for (const panel of plot.panels) {
        if (panel === this || panel.space !== this.space) continue;
        const twin = panel.index === this.index && plot !== this.plot && plot.scene.axes.length === this.plot.scene.axes.length;
        const beside = plot === this.plot && !this.space && !this.axes.equal && !panel.axes.equal && String(panel.axes.xlim) === String(this.axes.xlim) && panel.axes.xlog === this.axes.xlog;
        if (twin && this.plot.group && plot.group === this.plot.group) Object.assign(panel, { xlim: [...this.xlim], ylim: [...this.ylim], elev: this.elev, azim: this.azim, scale: this.scale });
        else if (beside) panel.xlim = [...this.xlim];
        else continue;
        panel.request();
      }
    }
    this.request();
  }

  // -- values under the pointer -----------------------------------------------------------------------
  points() {
    const result = [];
    this.plot.artists.forEach((artist, at) => {
      if (artist.a !== this.index || artist.h === 1 || this.plot.hidden.has(at) || artist.k) return;
      if (artist.t === "paths" && artist.g && !(artist.f || []).some(Boolean)) { // routes; polygons have a face
        const [step, names] = this.space ? [3, ["x", "y", "z"]] : [2, ["x", "y"]];
        for (const line of artist.p.flat()) {
          for (let i = 0; i < line.length && line[0] !== "o"; i += step) {
            result.push({ artist, ...Object.fromEntries(names.map((name, k) => [name, [line[i + k]]])) });
          }
        }
      }
      if (artist.t !== "line" && artist.t !== "points") return;
      if (artist.t === "line" && !artist.g && !artist.l && !artist.m) return;
      artist.x.forEach((value, i) => {
        if (value !== null && artist.y[i] !== null) result.push({ artist, x: [value], y: [artist.y[i]], ...(artist.z ? { z: [artist.z[i]] } : {}) });
      });
    });
    return result;
  }

  nearest(px, py) {
    let best = REACH;
    let spot = null;
    for (const point of this.points()) {
      const [[x, y]] = this.map.places(point);
      const distance = Math.hypot(x - px, y - py);
      if (distance < best && this.map.near(x, y)) { best = distance; spot = point; }
    }
    return spot;
  }

  show(spot) {
    this.spot = spot;
    this.tip.hidden = !spot;
    if (spot) {
      const name = spot.artist.l || spot.artist.g.replace(/^curve /, "");
      const lines = ["x", "y", "z"].filter((key) => spot[key]).map((key) => {
        const [label, unit] = split(this.axes[`${key}label`] || key);
        const fixed = (this.axes[`${key}ticks`] || []).find(([value]) => Math.abs(value - spot[key][0]) < 1e-9);
        return `${label || key}: ${fixed && !this.space ? fixed[1] : number(spot[key][0])}${unit ? ` ${unit}` : ""}`;
      });
      this.tip.replaceChildren(...[name, ...lines].filter(Boolean).map((text) => make("div", { textContent: text })));
      const [[x, y]] = this.map.places(spot);
      const wide = this.tip.offsetWidth;
      this.tip.style.left = `${Math.max(0, Math.min(x + 12, this.stage.clientWidth - wide - 2))}px`;
      this.tip.style.top = `${Math.max(0, y - this.tip.offsetHeight - 10)}px`;
    }
    this.request();
  }

  listen() {
    const { stage } = this;
    let from = null;
    stage.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      from = [event.clientX, event.clientY];
      stage.setPointerCapture(event.pointerId);
    });
    stage.addEventListener("pointermove", (event) => {
      const frame = stage.getBoundingClientRect();
      if (from) {
        this.show(null);
        this.pan(event.clientX - from[0], event.clientY - from[1]);
        from = [event.clientX, event.clientY];
      } else if (this.map) this.show(this.nearest(event.clientX - frame.left, event.clientY - frame.top));
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) stage.addEventListener(name, () => { from = null; });
    stage.addEventListener("pointerleave", () => this.show(null));
    stage.addEventListener("dblclick", () => { this.home(); this.linked(); });
    stage.addEventListener("wheel", (event) => { // a page that scrolls must not zoom by accident
      if (!event.ctrlKey && document.activeElement !== stage) return;
      event.preventDefault();
      const frame = stage.getBoundingClientRect();
      this.zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, [event.clientX - frame.left, event.clientY - frame.top]);
    }, { passive: false });
    const moves = { ArrowLeft: [30, 0], ArrowRight: [-30, 0], ArrowUp: [0, 30], ArrowDown: [0, -30] };
    stage.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const moving = this.plot.toggle ? this.plot : plots.find((plot) => plot.toggle);
      if (moves[event.key]) this.pan(...moves[event.key].map((step) => (this.space ? -step / 2 : step)));
      else if (event.key === "+" || event.key === "=") this.zoom(1.4);
      else if (event.key === "-") this.zoom(1 / 1.4);
      else if (event.key === "0" || event.key === "Home") { this.home(); this.linked(); } else if (event.key === "." || event.key === ",") {
        const points = this.points();
        if (!points.length) return;
        this.cursor = ((this.cursor ?? (event.key === "." ? -1 : 0)) + (event.key === "." ? 1 : -1) + points.length) % points.length;
        this.show(points[this.cursor]);
        this.plot.say(this.tip.innerText.replace(/\n/g, ", "));
      } else if (event.key === "Escape") { this.show(null); this.pin = null; this.request(); } else if (event.key === " " && moving) moving.toggle();
      else return;
      event.preventDefault();
    });
  }
}
