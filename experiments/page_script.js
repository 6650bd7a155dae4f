// The page is whole without this script. With it: charts zoom and say what lies under the pointer, series switch off,
// alternatives become tabs, tables can be copied, and the theme can be chosen.
"use strict";
(() => {
const LEFT = 62, RIGHT = 14, TOP = 40, BOTTOM = 42, FULL = 50000, SVG = "http://www.w3.org/2000/svg";
const all = (root, what) => [...root.querySelectorAll(what)];
const make = (tag, text, parent) => {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (parent) parent.append(made);
  return made;
};
const shape = (tag, parent, attributes) => {
  const made = document.createElementNS(SVG, tag);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  parent.append(made);
  return made;
};
const pressed = (parent, text, label, act) => {
  const button = make("button", text, parent);
  button.type = "button";
  button.className = "tool";
  button.setAttribute("aria-label", label);
  button.title = label;
  button.addEventListener("click", act);
  return button;
};

// Labels of an axis: the rule of charts/ticks.py.
function labelled(value, span) {
  if (Math.abs(value) < 1e-9 * span) return "0";
  if (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5) return value.toExponential(3).replace(/\.?0*e\+?/, "e");
  const text = value.toFixed(Math.min(6, Math.max(0, 2 - Math.floor(Math.log10(Math.abs(span))))));
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}
function linear(low, high, most) {
  const least = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(least));
  const step = power * [1, 2, 5, 10].find(m => m * power >= least * (1 - 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= Math.floor(high / step + 1e-9); k++) found.push(k * step);
  return found;
}
function ticks(low, high, log, most) {
  if (!log) return linear(low, high, most).map(v => [v, labelled(v, high - low)]);
  if (high - low < 0.7) {
    const a = 10 ** low, b = 10 ** high;
    return linear(a, b, most).filter(v => v > 0).map(v => [Math.log10(v), labelled(v, b - a)]);
  }
  const first = Math.ceil(low - 1e-9), last = Math.floor(high + 1e-9), count = last - first + 1;
  const every = Math.max(1, Math.ceil(count / most)), found = [];
  for (let d = first; d <= last; d++) if (d % every === 0) found.push([d, labelled(10 ** d, 10 ** d)]);
  if (count < 3)
    for (let d = Math.floor(low); d <= Math.ceil(high); d++)
      for (const m of [2, 5]) {
        const at = d + Math.log10(m);
        if (at >= low && at <= high) found.push([at, labelled(m * 10 ** d, 10 ** d)]);
      }
  return found;
}

class Panel {
  constructor(svg) {
    this.svg = svg;
    this.box = svg.querySelector(".box");
    this.dots = svg.querySelector(".dots");
    this.axes = svg.querySelector(".axes");
    this.height = +svg.getAttribute("height");
    const native = +svg.getAttribute("width");
    [this.x, this.y] = [svg.dataset.x, svg.dataset.y].map(t => t.split(" ").map(Number));
    this.log = svg.dataset.log.split(" ").map(Number);
    this.link = svg.dataset.link;
    const w = native - LEFT - RIGHT, h = this.height - TOP - BOTTOM;
    this.marks = all(this.dots, "path").map(path => ({
      path, tail: path.classList.contains("mo") ? "h0" : "m-3-3l6 6m0-6l-6 6",
      at: [...path.getAttribute("d").matchAll(/M(-?[\d.]+) (-?[\d.]+)/g)].map(m => [m[1] / w, m[2] / h]),
    }));
    this.whole();
  }
  whole() { this.view = [0, 1, 0, 1]; }
  draw() {
    const width = this.svg.clientWidth;
    if (!width) return;
    const w = this.w = Math.max(40, width - LEFT - RIGHT), h = this.h = this.height - TOP - BOTTOM;
    const [x0, x1, y0, y1] = this.view;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${this.height}`);
    for (const inner of [this.box, this.dots]) inner.setAttribute("width", w);
    this.box.setAttribute("viewBox", `${x0 * FULL} ${(1 - y1) * FULL} ${(x1 - x0) * FULL} ${(y1 - y0) * FULL}`);
    for (const mark of this.marks) {
      const placed = mark.at.map(([u, v]) => [(u - x0) / (x1 - x0) * w, (v - (1 - y1)) / (y1 - y0) * h]);
      mark.path.setAttribute("d", placed.filter(p => p[0] > -9 && p[0] < w + 9)
        .map(p => `M${p[0].toFixed(1)} ${p[1].toFixed(1)}${mark.tail}`).join(""));
    }
    this.label(w, h);
  }
  span(axis) {
    const ends = axis ? this.y : this.x, view = this.view.slice(2 * axis, 2 * axis + 2);
    return view.map(part => ends[0] + part * (ends[1] - ends[0]));
  }
  label(w, h) {
    this.axes.replaceChildren();
    const [a, b] = this.span(0), [c, d] = this.span(1);
    const write = (x, y, anchor, text) =>
      shape("text", this.axes, { x: x.toFixed(1), y: y.toFixed(1), "text-anchor": anchor }).textContent = text;
    for (const [at, text] of ticks(a, b, this.log[0], Math.max(3, Math.floor(w / 70)))) {
      const x = LEFT + w * (at - a) / (b - a);
      shape("path", this.axes, { class: "grid", d: `M${x.toFixed(1)} ${TOP}v${h}` });
      write(x, TOP + h + 15, "middle", text);
    }
    for (const [at, text] of ticks(c, d, this.log[1], Math.max(2, Math.floor(h / 32)))) {
      const y = TOP + h * (1 - (at - c) / (d - c));
      shape("path", this.axes, { class: "grid", d: `M${LEFT} ${y.toFixed(1)}h${w}` });
      write(LEFT - 6, y + 4, "end", text);
    }
    shape("path", this.axes, { class: "frame", d: `M${LEFT} ${TOP}v${h}h${w}` });
    write(LEFT + w / 2, TOP + h + 33, "middle", this.svg.dataset.xl);
  }
  value(axis, part) {
    const [a, b] = this.span(axis), at = a + part * (b - a);
    return this.log[axis] ? 10 ** at : at;
  }
  // A line's value under the pointer; only lines that run on to the right have one.
  under(path, u) {
    if (!path.points) {
      path.points = [];
      for (const piece of path.getAttribute("d").split("M").slice(1)) {
        const numbers = piece.match(/-?\d+/g).map(Number);
        let [x, y] = numbers;
        path.points.push([x, y]);
        for (let i = 2; i + 1 < numbers.length; i += 2) path.points.push([x += numbers[i], y += numbers[i + 1]]);
      }
      path.rising = path.points.every((p, i, list) => !i || p[0] >= list[i - 1][0]);
    }
    if (!path.rising || !path.points.length) return null;
    const target = (this.view[0] + u * (this.view[1] - this.view[0])) * FULL;
    let low = 0, high = path.points.length - 1;
    if (target < path.points[0][0] || target > path.points[high][0]) return null;
    while (high - low > 1) { const middle = (low + high) >> 1; path.points[middle][0] <= target ? low = middle : high = middle; }
    const near = target - path.points[low][0] < path.points[high][0] - target ? low : high;
    const at = this.y[0] + (1 - path.points[near][1] / FULL) * (this.y[1] - this.y[0]);
    return this.log[1] ? 10 ** at : at;
  }
}

class Figure {
  constructor(figure) {
    this.figure = figure;
    this.read = figure.querySelector(".read");
    this.panels = all(figure, "svg.panel").map(svg => new Panel(svg));
    this.active = this.panels[0];
    this.legend();
    for (const panel of this.panels) this.listen(panel);
    const seen = new ResizeObserver(() => this.panels.forEach(p => p.draw()));
    for (const panel of this.panels) seen.observe(panel.svg);
  }
  legend() {
    const legend = this.figure.querySelector(".legend");
    for (const key of all(legend, "button[data-s]"))
      key.addEventListener("click", () => {
        const on = key.getAttribute("aria-pressed") !== "true";
        key.setAttribute("aria-pressed", on);
        for (const path of all(this.figure, `.panel path[data-s="${key.dataset.s}"]`)) path.style.display = on ? "" : "none";
      });
    const tools = make("span", "", legend);
    tools.className = "tools";
    for (const [text, label, act] of [
      ["−", "zoom out", () => this.scale(1.6, 0)], ["+", "zoom in", () => this.scale(1 / 1.6, 0)],
      ["◀", "move left", () => this.move(-0.25, 0)], ["▶", "move right", () => this.move(0.25, 0)],
      ["whole", "show the whole figure", () => this.whole()]]) pressed(tools, text, label, act);
  }
  same(panel) { return panel.link ? this.panels.filter(p => p.link === panel.link) : [panel]; }
  set(panel, axis, low, high) {
    const width = Math.min(1, Math.max(1e-4, high - low)), from = Math.min(1 - width, Math.max(0, low));
    for (const one of axis ? [panel] : this.same(panel)) {
      one.view[2 * axis] = from;
      one.view[2 * axis + 1] = from + width;
      one.draw();
    }
  }
  scale(factor, axis) {
    const [a, b] = this.active.view.slice(2 * axis, 2 * axis + 2), middle = (a + b) / 2, half = factor * (b - a) / 2;
    this.set(this.active, axis, middle - half, middle + half);
  }
  move(part, axis) {
    const [a, b] = this.active.view.slice(2 * axis, 2 * axis + 2);
    this.set(this.active, axis, a + part * (b - a), b + part * (b - a));
  }
  whole() { for (const panel of this.panels) { panel.whole(); panel.draw(); } }
  listen(panel) {
    const svg = panel.svg;
    let from = null, frame = null;
    const at = event => {
      const corner = svg.getBoundingClientRect();
      return [event.clientX - corner.left - LEFT, event.clientY - corner.top - TOP];
    };
    const inside = ([x, y]) => [Math.min(panel.w, Math.max(0, x)), Math.min(panel.h, Math.max(0, y))];
    svg.addEventListener("focus", () => { this.active = panel; });
    svg.addEventListener("pointerdown", event => {
      this.active = panel;
      if (event.button) return;
      from = inside(at(event));
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", event => {
      const now = inside(at(event));
      this.tell(panel, now);
      if (!from) return;
      frame ??= shape("rect", svg, { class: "select" });
      const tall = Math.abs(now[1] - from[1]) > 14;
      for (const [key, value] of Object.entries({
        x: LEFT + Math.min(from[0], now[0]), width: Math.abs(now[0] - from[0]),
        y: TOP + (tall ? Math.min(from[1], now[1]) : 0), height: tall ? Math.abs(now[1] - from[1]) : panel.h,
      })) frame.setAttribute(key, value);
    });
    const end = event => {
      if (!from) return;
      const now = inside(at(event)), [x0, x1, y0, y1] = panel.view, start = from;
      from = null;
      frame?.remove();
      frame = null;
      if (Math.abs(now[0] - start[0]) > 6) {
        const [a, b] = [start[0], now[0]].sort((p, q) => p - q).map(x => x0 + x / panel.w * (x1 - x0));
        this.set(panel, 0, a, b);
      }
      if (Math.abs(now[1] - start[1]) > 14) {
        const [a, b] = [start[1], now[1]].sort((p, q) => q - p).map(y => y1 - y / panel.h * (y1 - y0));
        this.set(panel, 1, a, b);
      }
    };
    svg.addEventListener("pointerup", end);
    svg.addEventListener("pointercancel", () => { from = null; frame?.remove(); frame = null; });
    svg.addEventListener("pointerleave", () => { this.read.textContent = ""; });
    svg.addEventListener("dblclick", () => this.whole());
    svg.addEventListener("keydown", event => this.key(event));
  }
  key(event) {
    const axis = event.shiftKey ? 1 : 0;
    const acts = {
      ArrowLeft: () => this.move(-0.2, 0), ArrowRight: () => this.move(0.2, 0), ArrowUp: () => this.move(0.2, 1),
      ArrowDown: () => this.move(-0.2, 1), "+": () => this.scale(1 / 1.5, 0), "=": () => this.scale(1 / 1.5, 0),
      "*": () => this.scale(1 / 1.5, 1), "-": () => this.scale(1.5, axis), _: () => this.scale(1.5, 1),
      0: () => this.whole(), Home: () => this.whole(),
    };
    if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    acts[event.key]();
  }
  tell(panel, [x, y]) {
    const u = x / panel.w, parts = [`${panel.svg.dataset.xl} = ${panel.value(0, u).toPrecision(4)}`];
    parts.push(`pointer at ${panel.value(1, 1 - y / panel.h).toPrecision(3)}`);
    const keys = all(this.figure, ".legend button[data-s]");
    for (const path of all(panel.box, "path[data-s]:not(.fill)")) {
      if (path.style.display === "none") continue;
      const value = panel.under(path, u), name = keys.find(k => k.dataset.s === path.dataset.s)?.textContent;
      if (value !== null && parts.length < 8) parts.push(`${name ?? "value"} ${value.toPrecision(3)}`);
    }
    this.read.textContent = parts.join("   ");
  }
}

function tabbed(holder) {
  const tabs = all(holder, ":scope > .tab"), list = document.createElement("div");
  list.className = "tablist";
  list.setAttribute("role", "tablist");
  holder.prepend(list);
  const show = chosen => buttons.forEach((button, i) => {
    button.setAttribute("aria-selected", i === chosen);
    button.tabIndex = i === chosen ? 0 : -1;
    tabs[i].hidden = i !== chosen;
  });
  const buttons = tabs.map((tab, i) => {
    const button = make("button", tab.dataset.label, list);
    button.type = "button";
    button.setAttribute("role", "tab");
    button.setAttribute("aria-controls", tab.id);
    tab.setAttribute("role", "tabpanel");
    tab.setAttribute("aria-label", tab.dataset.label);
    button.addEventListener("click", () => show(i));
    button.addEventListener("keydown", event => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = (i + step + tabs.length) % tabs.length;
      show(next);
      buttons[next].focus();
    });
    return button;
  });
  show(0);
}

function copied(text) {
  const area = make("textarea", "", document.body);
  area.value = text;
  area.select();
  const done = document.execCommand("copy");
  area.remove();
  return done;
}
function copyable(holder) {
  const rows = () => all(holder, "tr").map(row => [...row.cells].map(cell => cell.textContent.trim()).join("\t")).join("\n");
  const button = make("button", "copy table");
  button.type = "button";
  button.className = "tool";
  holder.before(button);
  button.addEventListener("click", () => {
    button.textContent = copied(rows()) ? "copied" : "select it and copy";
    setTimeout(() => { button.textContent = "copy table"; }, 1500);
  });
}

document.documentElement.classList.add("js");
all(document, "figure.chart").forEach(figure => new Figure(figure));
all(document, ".tabs").forEach(tabbed);
all(document, "div.wide").filter(holder => holder.querySelector("table")).forEach(copyable);
const themes = ["as the system", "light", "dark"];
let theme = 0;
const choice = pressed(document.querySelector("header"), "theme: as the system", "change between light and dark", () => {
  theme = (theme + 1) % 3;
  if (theme) document.documentElement.dataset.theme = themes[theme];
  else delete document.documentElement.dataset.theme;
  choice.textContent = `theme: ${themes[theme]}`;
});
})();
