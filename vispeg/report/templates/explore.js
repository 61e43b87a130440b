"use strict";
// Effects switched on and off: shows the row of worked-out residuals that belongs to the choice.
(function () {
  for (const root of document.querySelectorAll("[data-explore]")) explore(root);

  function explore(root) {
    const data = JSON.parse(root.querySelector("[data-choices]").textContent);
    const one = (name) => root.querySelector(`[data-${name}]`);
    const all = (name) => [...root.querySelectorAll(`[data-${name}]`)];
    const charts = [], SMALLER = [["", 1], ["m", 1e3], ["µ", 1e6]];
    let row = data.start, recording = 0, sharedScale = false;

    for (const r of data.recordings) r.values = decoded(r, data.rows.length, data.joints.length);

    for (const button of all("effect")) button.addEventListener("click", () => {
      const wanted = (data.rival[row] ? data.on[data.start] : data.on[row]).slice();
      wanted[+button.dataset.effect] ^= 1;
      const next = find(wanted);
      if (next >= 0) show(next);
    });
    for (const button of all("rival")) button.addEventListener("click", () => {
      const i = +button.dataset.rival;
      show(i === row ? data.start : i);
    });
    for (const box of all("joint")) box.addEventListener("change", build);
    if (one("same")) one("same").addEventListener("change", (e) => { sharedScale = e.target.checked; build(); });
    if (one("recording")) one("recording").addEventListener("change", (e) => { recording = +e.target.value; build(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", build);
    new ResizeObserver(() => charts.forEach((c) => c.setSize({ width: width(), height: c.height }))).observe(one("plots"));
    build();
    show(row);

    function find(on) {
      return data.on.findIndex((o, i) => !data.rival[i] && o.every((v, k) => v === on[k]));
    }

    function show(next) {
      row = next;
      const r = data.rows[row];
      one("error").textContent = r.error;
      one("change").textContent = r.change;
      one("floor").textContent = r.floor;
      one("bar").style.width = r.at + "%";
      const base = data.rival[row] ? null : data.on[row];
      for (const button of all("effect")) {
        const k = +button.dataset.effect, on = base ? base[k] : 0;
        button.setAttribute("aria-checked", on ? "true" : "false");
        const turned = (base || data.on[data.start]).slice();
        turned[k] ^= 1;
        button.disabled = find(turned) < 0;
      }
      for (const button of all("rival")) button.setAttribute("aria-pressed", +button.dataset.rival === row);
      for (const chart of charts) {
        const { min, max } = chart.scales.x;
        chart.setData(lines(chart.joint), min == null);
        rescale(chart);
        if (min != null) chart.setScale("x", { min, max }); // the zoom stays; the other axis follows the new values
        chart.caption.textContent = r.joints[chart.joint] + " RMS";
      }
    }

    function lines(joint) {
      const r = data.recordings[recording];
      return sharedScale ? [r.time, r.values[0][joint], r.values[row][joint]] : [r.time, r.values[row][joint]];
    }

    function rescale(chart) { // the prefix that suits what is drawn
      const peak = Math.max(...chart.data.slice(1).flat().filter((v) => v != null).map(Math.abs), 0);
      const fits = data.prefixed ? SMALLER.filter(([, factor]) => peak * factor >= 1) : [];
      chart.prefix = fits[0] || (data.prefixed && peak > 0 ? SMALLER[2] : SMALLER[0]);
      chart.unit.textContent = chart.prefix[0] + data.unit;
    }

    function number(v) { return String(+v.toPrecision(3)); }

    function width() { return Math.max(240, one("plots").clientWidth); }

    function build() {
      for (const chart of charts.splice(0)) chart.destroy();
      const place = one("plots"), css = getComputedStyle(document.documentElement);
      const colour = (name) => css.getPropertyValue("--" + name).trim();
      place.replaceChildren();
      const axis = { stroke: colour("muted"), grid: { stroke: colour("rule"), width: 0.5 }, ticks: { show: false } };
      const value = (u, v) => (v == null ? "–" : number(v * u.prefix[1]) + " " + u.prefix[0] + data.unit);
      const trace = (label, name, wide) => ({ label, stroke: colour(name), width: wide, value, points: { show: false } });
      for (const box of all("joint")) {
        if (!box.checked) continue;
        const j = +box.dataset.joint, head = document.createElement("h3"), caption = document.createElement("span");
        const unit = document.createElement("span");
        caption.className = unit.className = "note";
        head.append(data.joints[j] + ": residual in ", unit, ", ", caption);
        place.append(head);
        const series = [{ label: "time", value: (u, v) => (v == null ? "–" : v.toFixed(2) + " s") }];
        if (sharedScale) series.push(trace("first model", "before", 0.8));
        series.push(trace("residual", "after", 1.2));
        const chart = new uPlot({
          width: width(), height: 120, series,
          cursor: { sync: { key: "explore", scales: ["x", null] }, drag: { x: true, y: false } },
          scales: { x: { time: false } },
          axes: [{ ...axis, size: 26, values: (u, v) => v.map((t) => t + " s") }, { ...axis, size: 58, space: 22, values: (u, v) => v.map((y) => number(y * u.prefix[1])) }],
          hooks: { setScale: [(u, key) => { if (key === "x") follow(u); }] },
        }, lines(j), place);
        Object.assign(chart, { joint: j, unit });
        rescale(chart);
        chart.caption = caption;
        caption.textContent = data.rows[row].joints[j] + " RMS";
        chart.root.setAttribute("role", "img");
        chart.root.setAttribute("aria-label", "Residual of " + data.joints[j] + " over time");
        charts.push(chart);
      }
    }

    let following = false;
    function follow(from) { // one time axis for all charts
      if (following) return;
      following = true;
      const { min, max } = from.scales.x;
      for (const chart of charts) if (chart !== from && min != null) chart.setScale("x", { min, max });
      following = false;
    }
  }

  function decoded(recording, choices, joints) {
    const raw = Uint8Array.from(atob(recording.codes), (c) => c.charCodeAt(0)), view = new DataView(raw.buffer);
    const n = recording.time.length, out = [];
    for (let i = 0; i < choices; i++) {
      out.push([]);
      for (let j = 0; j < joints; j++) {
        const scale = recording.scale[i][j], values = new Array(n);
        for (let t = 0; t < n; t++) {
          const code = view.getInt16(2 * ((i * joints + j) * n + t), true);
          values[t] = code === -32768 ? null : code * scale;
        }
        out[i].push(values);
      }
    }
    return out;
  }
})();
