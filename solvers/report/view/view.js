"use strict";
// -- one scene: panels in columns, legends and time ------------------------------------------------------
class Plot {
  constructor(host, scene, group) {
    Object.assign(this, { host, scene, group, hidden: new Set(), artists: scene.artists.map((artist) => ({ ...artist })) });
    this.live = make("div", { className: "unseen" });
    this.live.setAttribute("aria-live", "polite");
    this.panels = scene.axes.map((axes, index) => new Panel(this, index));
    const columns = this.layout(this.panels);
    host.append(columns);
    const foot = make("div", { className: "legends" });
    for (const legend of scene.legends) {
      const list = make("ul", { className: "legend" }, ...legend.keys.map((key) => make("li", {}, this.entry(key))));
      if (legend.axes === null) foot.append(list); else this.panels[legend.axes].head.append(list);
    }
    host.append(foot, this.live);
    if (scene.frames) this.motion(columns);
  }

  say(text) { this.live.textContent = text; }

  // Panels beside each other are in columns, and those below each other in rows, as in the figure.
  layout(panels) {
    if (panels.length === 1) return panels[0].element;
    const columns = this.cut(panels, 0);
    if (columns.length > 1) {
      const element = make("div", { className: "columns" });
      for (const column of columns) {
        const part = make("div", { className: "column" }, this.layout(column));
        const [left, right] = [Math.min(...column.map(({ axes }) => axes.box[0])), Math.max(...column.map(({ axes }) => axes.box[0] + axes.box[2]))];
        // Panels without ticks are small pictures in a row; the others need the width of their labels.
        const small = column.every(({ axes }) => axes.xticks && !axes.xticks.length);
        const basis = small ? 6 * this.cut(column, 0).length : Math.min(18, 42 / columns.length);
        part.style.flex = `${Math.round(100 * (right - left))} 1 ${basis}rem`;
        element.append(part);
      }
      return element;
    }
    const [first, ...rest] = this.cut(panels, 1);
    if (rest.length) return make("div", { className: "rows" }, this.layout(first), this.layout(rest.flat()));
    return make("div", { className: "rows" }, ...panels.map((panel) => panel.element));
  }

  cut(panels, side) {
    const groups = [];
    for (const panel of [...panels].sort((a, b) => a.axes.box[side] - b.axes.box[side])) {
      const { box } = panel.axes;
      const group = groups[groups.length - 1];
      if (group && box[side] < group.end - 0.01) {
        group.panels.push(panel);
        group.end = Math.max(group.end, box[side] + box[side + 2]);
      } else groups.push({ end: box[side] + box[side + 2], panels: [panel] });
    }
    return groups.map((group) => group.panels);
  }

  entry(key) {
    const swatch = make("canvas", { className: "swatch" });
    swatch.setAttribute("aria-hidden", "true");
    const paint = () => {
      const context = swatch.getContext("2d");
      const ratio = devicePixelRatio || 1;
      swatch.width = 26 * ratio; swatch.height = 14 * ratio;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      const { look } = key;
      if (look.t === "paths") {
        context.beginPath(); context.rect(3, 2, 20, 10);
        const face = tint(cycle(look.f, 0));
        if (face) { context.fillStyle = face; context.fill(); }
        stroke(context, tint(cycle(look.e, 0)), cycle(look.w, 0), cycle(look.d, 0));
      } else if (look.t) {
        context.beginPath(); context.moveTo(1, 7); context.lineTo(25, 7);
        stroke(context, tint(look.c), look.w, look.d);
        if (look.m) drawMarker(context, look, 0, 13, 7, false, 0.95);
      }
    };
    (this.swatches ||= []).push(paint);
    if (!key.of.length) return make("span", {}, swatch, key.label);
    const button = make("button", { type: "button", title: `Show or hide: ${key.label}` }, swatch, key.label);
    button.setAttribute("aria-pressed", "true");
    button.addEventListener("click", () => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(shown));
      key.of.forEach((at) => (shown ? this.hidden.delete(at) : this.hidden.add(at)));
      this.draw();
    });
    return button;
  }

  draw() {
    this.panels.forEach((panel) => panel.draw());
    (this.swatches || []).forEach((paint) => paint());
  }

  // -- time ---------------------------------------------------------------------------------------------
  motion(columns) {
    const { frames, interval } = this.scene;
    const play = make("button", { type: "button", className: "play", textContent: "▶ Play" });
    const slider = make("input", { type: "range", min: 0, max: frames.length - 1, value: 0, step: 1 });
    slider.setAttribute("aria-label", "Time");
    const clock = make("output", { className: "clock", textContent: frames[0].clock });
    columns.after(make("div", { className: "time" }, play, slider, clock));
    this.frame = -1;
    const base = { artists: this.scene.artists, axes: this.scene.axes.map((axes) => ({ ...axes })) };
    const apply = (frame) => {
      for (const [at, changes] of Object.entries(frame.artists)) {
        const artist = this.artists[at] ? { ...this.artists[at] } : {};
        for (const [key, value] of Object.entries(changes)) {
          if (key.endsWith("+")) artist[key[0]] = [...(artist[key[0]] || []).slice(0, value[0]), ...value.slice(1)];
          else if (value === null) delete artist[key];
          else artist[key] = value;
        }
        this.artists[at] = artist;
      }
      for (const [at, changes] of Object.entries(frame.axes || {})) {
        const panel = this.panels[at];
        Object.assign(panel.axes, changes);
        if (!panel.moved) panel.home();
      }
    };
    this.seek = (to) => {
      if (to < this.frame) {
        this.frame = -1;
        this.artists = base.artists.map((artist) => ({ ...artist }));
        this.panels.forEach((panel, at) => {
          Object.assign(panel.axes, base.axes[at]);
          if (!panel.moved && frames.some((frame) => frame.axes?.[at])) panel.home();
        });
      }
      while (this.frame < to) { this.frame += 1; apply(frames[this.frame]); }
      slider.value = to;
      clock.textContent = frames[to].clock;
      slider.setAttribute("aria-valuetext", frames[to].clock);
      this.draw();
    };
    let timer = 0;
    const stop = () => { clearInterval(timer); timer = 0; play.textContent = "▶ Play"; };
    this.toggle = () => {
      if (timer) { stop(); return; }
      if (this.frame >= frames.length - 1) this.seek(0);
      play.textContent = "❚❚ Pause";
      timer = setInterval(() => {
        this.seek(this.frame + 1);
        if (this.frame >= frames.length - 1) stop();
      }, Math.max(interval, 30));
    };
    play.addEventListener("click", this.toggle);
    slider.addEventListener("input", () => { stop(); this.seek(Number(slider.value)); });
    slider.addEventListener("keydown", (event) => { if (event.key === " ") { event.preventDefault(); this.toggle(); } });
    this.seek(0);
  }

  point(pin) {
    this.panels.forEach((panel) => { if (panel.pin) { panel.pin = null; panel.request(); } });
    const panel = this.panels[pin.axes];
    panel.pin = pin;
    const inside = ["x", "y"].every((name) => pin[name] >= Math.min(...panel[`${name}lim`]) && pin[name] <= Math.max(...panel[`${name}lim`]));
    if (!inside && !panel.space) { panel.home(); panel.linked(); }
    panel.stage.scrollIntoView({ block: "nearest" });
    panel.request();
  }
}

document.querySelectorAll("[data-scene]").forEach((host) => plots.push(new Plot(host, scenes[host.dataset.scene], host.dataset.group || "")));
document.querySelectorAll("button[data-pin]").forEach((button) => button.addEventListener("click", () => {
  const plot = plots.find((one) => one.host.dataset.scene === button.dataset.of);
  const table = button.closest("table");
  table.querySelectorAll("[aria-pressed]").forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
  plot.point(plot.scene.pins[Number(button.dataset.pin)]);
  plot.say(button.title);
}));
const draw = () => plots.forEach((plot) => plot.draw());
draw();
scheme.addEventListener("change", draw);
new ResizeObserver(() => draw()).observe(document.querySelector("main"));
