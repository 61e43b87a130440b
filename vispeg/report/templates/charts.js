"use strict";
// Charts one below another over one time axis, with a common cursor and zoom, unit prefixes, the colours of light or dark
// mode, and control by mouse, keys and buttons. Other scripts of a page draw with it.
const charts = (() => {
  const SMALLER = [["", 1], ["m", 1e3], ["µ", 1e6]], KEYS = "Arrow keys move the cursor, plus and minus zoom, 0 shows all.";
  let stacks = 0;

  const number = (v, digits = 3) => String(+v.toPrecision(digits)).replaceAll("-", "−");
  const tick = (v) => number(v, 10); // uPlot rounds ticks to their step; three digits would repeat in a zoomed chart

  function element(tag, name, text) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text) made.textContent = text;
    return made;
  }

  // Decodes rows of n numbers from 16-bit codes with a scale per row; the lowest code is a gap.
  function decoded(codes, scales, n) {
    const raw = Uint8Array.from(atob(codes), (c) => c.charCodeAt(0)), view = new DataView(raw.buffer);
    return scales.map((scale, row) => {
      const values = new Array(n);
      for (let t = 0; t < n; t++) {
        const code = view.getInt16(2 * (row * n + t), true);
        values[t] = code === -32768 ? null : code * scale;
      }
      return values;
    });
  }

  class Stack {
    // The charts are put into `place`; `moved(time)` is called when the cursor moves.
    constructor(place, moved = () => {}) {
      Object.assign(this, { place, moved, specs: [], drawn: [], key: "stack" + stacks++, at: null });
      this.spoken = element("p", "spoken");
      this.spoken.setAttribute("role", "status");
      place.setAttribute("tabindex", "0");
      place.setAttribute("role", "group");
      place.setAttribute("aria-label", "Charts over time. " + KEYS);
      const bar = element("div", "zoom");
      for (const [text, name, act] of [["+", "Zoom in", () => this.zoom(0.5)], ["−", "Zoom out", () => this.zoom(2)], ["All", "Show all", () => this.zoom(Infinity)]]) {
        const button = element("button", "", text);
        Object.assign(button, { type: "button", title: name });
        button.setAttribute("aria-label", name);
        button.addEventListener("click", act);
        bar.append(button);
      }
      place.before(bar);
      place.after(this.spoken);
      place.addEventListener("keydown", (e) => this.press(e));
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.show(this.specs));
      let before = 0;
      new ResizeObserver(() => {
        if (place.clientWidth === before) return;
        before = place.clientWidth;
        this.fit();
      }).observe(place);
    }

    // Each of `specs` is {title, note, unit, prefixed, lines: [{label, colour, width, dash, dots}], data: [time, ...], bands}.
    show(specs) {
      const { min, max } = this.range(), css = getComputedStyle(document.documentElement);
      const colour = (name) => css.getPropertyValue("--" + name).trim();
      for (const chart of this.drawn.splice(0)) chart.destroy();
      this.place.replaceChildren();
      this.specs = specs;
      for (const spec of specs) this.drawn.push(this.chart(spec, colour));
      this.fit();
      if (min != null && specs.length) this.set(min, max);
      queueMicrotask(() => { // after uPlot has set its scales
        const now = this.range();
        if (this.at != null && this.at >= now.min && this.at <= now.max) this.go(this.at);
      });
    }

    update(i, data, note) { // shows new values in a chart, at the same zoom
      const chart = this.drawn[i], { min, max } = chart.scales.x;
      chart.setData(data, min == null);
      this.name(chart);
      if (min != null) chart.setScale("x", { min, max }); // and lets the other axis fit the new values
      chart.note.textContent = note;
    }

    chart(spec, colour) {
      const cell = element("div", "plot"), head = element("h4", "", spec.title + ", "), unit = element("span", "note");
      const note = element("span", "note", spec.note || "");
      head.append(unit, " ", note);
      cell.append(head);
      this.place.append(cell);
      const value = (u, v) => (v == null ? "–" : number(v * u.prefix[1]) + " " + u.prefix[0] + spec.unit);
      const axis = { stroke: colour("muted"), grid: { stroke: colour("rule"), width: 0.5 }, ticks: { show: false } };
      const series = spec.lines.map((line) => ({
        label: line.label, stroke: colour(line.colour), width: line.dots ? 0 : line.width || 1.2, value,
        dash: line.dash ? [6, 4] : undefined, points: { show: !!line.dots, size: 6, fill: colour(line.colour) },
      }));
      const chart = new uPlot({
        width: 240, height: spec.height || 130,
        series: [{ label: "time", value: (u, v) => (v == null ? "–" : v.toFixed(3) + " s") }, ...series],
        cursor: { sync: { key: this.key, scales: ["x", null] }, drag: { x: true, y: false } },
        scales: { x: { time: false } },
        axes: [
          { ...axis, size: 26, values: (u, v) => v.map((t) => tick(t) + " s") },
          { ...axis, size: 58, space: 22, values: (u, v) => v.map((y) => tick(y * u.prefix[1])) },
        ],
        hooks: {
          setScale: [(u, key) => { if (key === "x") this.follow(u); }],
          setCursor: [(u) => this.told(u)],
          drawClear: [(u) => this.shade(u, spec.bands || [], colour("before"))],
        },
      }, spec.data, cell);
      Object.assign(chart, { spec, unit, note, cell });
      chart.root.setAttribute("role", "img");
      chart.root.setAttribute("aria-label", `${spec.title} over time: ${spec.lines.map((l) => l.label).join(", ")}`);
      this.name(chart);
      return chart;
    }

    name(chart) { // sets the unit's prefix for the drawn values
      let peak = 0;
      for (const row of chart.data.slice(1)) for (const v of row) if (v != null && Math.abs(v) > peak) peak = Math.abs(v);
      const { prefixed, unit } = chart.spec, fits = prefixed ? SMALLER.filter(([, factor]) => peak * factor >= 0.1) : [];
      chart.prefix = fits[0] || (prefixed && peak > 0 ? SMALLER[2] : SMALLER[0]);
      chart.unit.textContent = chart.prefix[0] + unit;
      chart.redraw(false, true);
    }

    shade(u, bands, colour) {
      const { left, top, width, height } = u.bbox;
      u.ctx.save();
      u.ctx.globalAlpha = 0.25;
      u.ctx.fillStyle = colour;
      for (const [from, to] of bands) {
        const a = Math.max(left, u.valToPos(from, "x", true)), b = Math.min(left + width, u.valToPos(to, "x", true));
        if (b >= a) u.ctx.fillRect(a, top, Math.max(b - a, 2), height);
      }
      u.ctx.restore();
    }

    fit() {
      for (const chart of this.drawn) chart.setSize({ width: Math.max(200, chart.cell.clientWidth), height: chart.height });
    }

    range() {
      return this.drawn.length ? this.drawn[0].scales.x : { min: null, max: null };
    }

    ends() {
      const time = this.drawn[0].data[0];
      return [time[0], time[time.length - 1]];
    }

    set(min, max) {
      const [first, last] = this.ends();
      const a = Math.max(first, min), b = Math.min(last, max);
      if (b > a) this.drawn[0].setScale("x", { min: a, max: b });
    }

    zoom(factor) { // zooms about the cursor, or the middle
      if (!this.drawn.length) return;
      const { min, max } = this.range();
      const at = this.at == null || this.at < min || this.at > max ? (min + max) / 2 : this.at;
      this.set(at - (at - min) * factor, at + (max - at) * factor);
    }

    go(time) { // moves the cursor to a time, and the time into view
      const chart = this.drawn[0];
      if (!chart) return;
      const { min, max } = this.range(), half = (max - min) / 2;
      if (time < min || time > max) this.set(time - half, time + half);
      queueMicrotask(() => { // after uPlot has set its scales
        const left = chart.valToPos(time, "x");
        if (Number.isFinite(left) && chart === this.drawn[0]) chart.setCursor({ left: Math.max(0, left), top: 10 }, true, true);
      });
    }

    press(e) {
      if (e.target !== this.place || !this.drawn.length || e.ctrlKey || e.metaKey || e.altKey) return;
      const { min, max } = this.range(), step = (max - min) / (e.shiftKey ? 20 : 200), at = this.at == null ? min : this.at;
      const acts = {
        ArrowLeft: () => this.go(Math.max(this.ends()[0], at - step)), ArrowRight: () => this.go(Math.min(this.ends()[1], at + step)),
        Home: () => this.go(this.ends()[0]), End: () => this.go(this.ends()[1]),
        "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), 0: () => this.zoom(Infinity), Escape: () => this.zoom(Infinity),
      };
      if (!(e.key in acts)) return;
      e.preventDefault();
      acts[e.key]();
      clearTimeout(this.waiting);
      this.waiting = setTimeout(() => this.say(), 400);
    }

    say() { // tells screen readers the values at the cursor
      const chart = this.drawn[0], k = chart.cursor.idx;
      if (k == null) return;
      const values = chart.spec.lines.map((line, i) => `${line.label} ${chart.series[i + 1].value(chart, chart.data[i + 1][k])}`);
      this.spoken.textContent = `${chart.spec.title} at ${chart.data[0][k].toFixed(3)} s: ${values.join(", ")}`;
    }

    told(u) {
      if (u !== this.drawn[0] || u.cursor.idx == null || u.cursor.left < 0) return;
      const time = u.data[0][u.cursor.idx];
      if (time === this.at) return;
      this.at = time;
      this.moved(time);
    }

    follow(from) { // gives all charts the time axis of one
      if (this.following) return;
      this.following = true;
      const { min, max } = from.scales.x;
      if (min != null) for (const chart of this.drawn) if (chart !== from) chart.setScale("x", { min, max });
      this.following = false;
    }
  }

  return { Stack, decoded, element, number };
})();
