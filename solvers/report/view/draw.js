"use strict";
// Colours, numbers and artists: what models/plots/artists.py describes is drawn on a canvas.

const scenes = JSON.parse(document.getElementById("scenes").textContent);
const POINT = 1.25; // pixels per point
const REACH = 14; // pixels from the pointer to the nearest point
const scheme = matchMedia("(prefers-color-scheme: dark)");
const plots = [];

const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};

// -- colours: pictures are drawn for white paper --------------------------------------------------
const PAPER = { light: [255, 255, 255], dark: [20, 23, 26] };
const tints = new Map();
const darken = (rgb, mapped) => {
  const [low, high] = [Math.min(...rgb), Math.max(...rgb)];
  const light = (low + high) / 510;
  if (mapped) return rgb.map((part) => part + 0.3 * (255 - part));
  if (high - low < 36) { // greys change places
    const grey = 1 - light;
    return PAPER.dark.map((part) => part + (240 - part) * grey ** 0.75);
  }
  const target = light > 0.8 ? 1 - light + 0.08 : Math.max(1 - light, 0.56);
  if (target < light) return rgb.map((part) => part * (target / light));
  const share = (target - light) / (1 - light);
  return rgb.map((part) => part + (255 - part) * share);
};
const tint = (colour, mapped) => {
  if (!colour || !scheme.matches) return colour || null;
  const key = colour + (mapped ? "m" : "");
  if (!tints.has(key)) {
    const rgb = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    const alpha = colour.length > 7 ? parseInt(colour.slice(7), 16) / 255 : 1;
    tints.set(key, `rgba(${darken(rgb, mapped).map(Math.round).join(",")},${alpha})`);
  }
  return tints.get(key);
};
const theme = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Greys of an image change as those of lines do; other colours are those of its scale.
const pictures = new Map();
const picture = (source, mapped, ready) => {
  const key = source + scheme.matches;
  const known = pictures.get(key);
  if (Array.isArray(known)) known.push(ready); // several panels wait for the same image
  if (known) return Array.isArray(known) ? null : known;
  const waiting = [ready];
  pictures.set(key, waiting);
  const image = new Image();
  image.onload = () => {
    const canvas = make("canvas", { width: image.width, height: image.height });
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    if (scheme.matches && !mapped) {
      const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
      for (let at = 0; at < pixels.data.length; at += 4) {
        const rgb = [...pixels.data.subarray(at, at + 3)];
        if (Math.max(...rgb) - Math.min(...rgb) < 36) pixels.data.set(darken(rgb), at);
      }
      context.putImageData(pixels, 0, 0);
    }
    pictures.set(key, canvas);
    waiting.forEach((call) => call());
  };
  image.src = source;
  return null;
};

// -- numbers and ticks ------------------------------------------------------------------------------
const number = (value, digits = 6) => {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text = size && (size >= 1e7 || size < 1e-4)
    ? value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e")
    : String(Number(value.toPrecision(digits)));
  return text.replace(/-/g, "−");
};
const ticksOf = (low, high, log, count) => {
  if (low > high) [low, high] = [high, low];
  const result = [];
  if (log) {
    const decades = Math.log10(high / low);
    const step = Math.ceil(decades / count);
    for (let power = Math.ceil(Math.log10(low)); power <= Math.log10(high); power += step) result.push(10 ** power);
    if (result.length > 1) return result;
  }
  const rough = (high - low) / Math.max(count, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
  for (let at = Math.ceil(low / step - 1e-9); at <= high / step + 1e-9 && result.length < 60; at += 1) {
    result.push(Number((at * step).toPrecision(12)));
  }
  // A single tick shows no scale.
  if (result.length < 2 && count < 8) return ticksOf(low, high, log, count + 1);
  return result.filter((value) => !log || value > 0);
};
const split = (label) => { // "time (s)" gives a name and a unit, "mass (–)" and "row (index, downward)" no unit
  const text = label.replace(/\s*\n\s*/g, " ");
  const parts = /^(.*?)\s*\(([^(),]+)[^()]*\)$/.exec(text);
  return parts ? [parts[1], ["–", "-", "index"].includes(parts[2]) ? "" : parts[2]] : [text, ""];
};

// -- drawing ----------------------------------------------------------------------------------------
const cycle = (list, at) => (list && list.length ? list[at % list.length] : null);
const drawMarker = (context, artist, at, x, y, mapped, zoom = 1) => {
  const face = tint(cycle(artist.f, at), mapped);
  const edge = tint(cycle(artist.e, at), mapped);
  const width = artist.mw === undefined ? cycle(artist.w, at) : artist.mw;
  context.beginPath();
  if (artist.m === "o") {
    context.arc(x, y, (cycle(artist.s, at) / 2) * POINT * zoom, 0, 7);
  } else {
    for (const line of cycle(artist.m, at)) {
      for (let i = 0; i < line.length; i += 2) {
        context.lineTo(x + line[i] * POINT * zoom, y - line[i + 1] * POINT * zoom);
        if (i === 0) context.moveTo(x + line[0] * POINT * zoom, y - line[1] * POINT * zoom);
      }
    }
  }
  if (face) { context.fillStyle = face; context.fill(); }
  if (edge && width) {
    context.strokeStyle = edge; context.lineWidth = width * POINT; context.setLineDash([]); context.stroke();
  }
};
const stroke = (context, colour, width, dashes) => {
  if (!colour || !width) return;
  context.strokeStyle = colour;
  context.lineWidth = Math.max(width * POINT, 0.6);
  context.setLineDash((dashes || []).map((length) => length * POINT));
  context.stroke();
};
const drawArtist = (context, artist, map, ready) => {
  const mapped = Boolean(artist.v);
  if (artist.t === "line" || artist.t === "points") {
    const places = map.places(artist);
    if (artist.c) {
      context.beginPath();
      let pen = false;
      for (const [x, y] of places) {
        if (Number.isNaN(x + y)) { pen = false; continue; }
        if (pen) context.lineTo(x, y); else context.moveTo(x, y);
        pen = true;
      }
      stroke(context, tint(artist.c, mapped), artist.w, artist.d);
    }
    if (artist.m) {
      places.forEach(([x, y], at) => {
        if (!Number.isNaN(x + y) && map.near(x, y)) drawMarker(context, artist, at, x, y, mapped);
      });
    }
  } else if (artist.t === "paths") {
    const order = artist.p.map((lines, at) => at);
    if (artist.fill) { // faces of a body: those behind first
      const depth = artist.p.map((lines) => map.depth(lines[0]));
      order.sort((a, b) => depth[a] - depth[b]);
    }
    for (const at of order) {
      context.beginPath();
      for (const line of artist.p[at]) {
        if (line[0] === "o") {
          const [, x, y, rx, ry] = line;
          const [[px, py], [qx, qy]] = map.flat([x, y, x + rx, y + ry], artist.k || "");
          context.moveTo(px + Math.abs(qx - px), py);
          context.ellipse(px, py, Math.abs(qx - px), Math.abs(qy - py), 0, 0, 7);
          continue;
        }
        map.flat(line, artist.k || "").forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
        if (artist.fill) context.closePath();
      }
      const face = tint(cycle(artist.f, at), mapped);
      if (face) { context.fillStyle = face; context.fill(); }
      stroke(context, tint(cycle(artist.e, at), mapped), cycle(artist.w, at), cycle(artist.d, at));
    }
  } else if (artist.t === "image") {
    const image = picture(artist.src, mapped, ready);
    if (!image) return;
    const [[left, top], [right, bottom]] = map.places({ x: artist.x, y: artist.y });
    context.imageSmoothingEnabled = Boolean(artist.soft);
    context.save();
    context.translate(left, top);
    context.scale((right - left) / image.width, (bottom - top) / image.height);
    context.drawImage(image, 0, 0);
    context.restore();
  } else if (artist.t === "text") {
    const [[x, y]] = map.places(artist);
    if (Number.isNaN(x + y) || !map.near(x, y)) return;
    context.save();
    context.translate(x + (artist.dx || 0) * POINT, y - (artist.dy || 0) * POINT);
    if (artist.r) context.rotate((-artist.r * Math.PI) / 180);
    const size = Math.max(artist.n * POINT, 9);
    context.font = `${size}px system-ui, sans-serif`;
    context.textAlign = artist.ha;
    context.textBaseline = { center: "middle", center_baseline: "middle", top: "top", bottom: "bottom" }[artist.va] || "alphabetic";
    artist.s.split("\n").forEach((line, at) => {
      const down = at * size * 1.2;
      if (artist.halo) {
        context.strokeStyle = theme("--paper"); context.lineWidth = 3; context.setLineDash([]); context.lineJoin = "round";
        context.strokeText(line, 0, down);
      }
      context.fillStyle = tint(artist.c) || theme("--ink");
      context.fillText(line, 0, down);
    });
    context.restore();
  }
};
