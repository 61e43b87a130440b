"use strict";
// Recorded signals: the reader chooses recording, joints and lines.
for (const root of document.querySelectorAll("[data-traces]")) {
  const data = JSON.parse(root.querySelector("[data-values]").textContent);
  const one = (name) => root.querySelector(`[data-${name}]`);
  const checked = (name) => [...root.querySelectorAll(`[data-${name}]`)].filter((box) => box.checked).map((box) => +box.dataset[name]);
  const place = one("plots"), tell = (name, detail) => root.dispatchEvent(new CustomEvent(name, { detail }));
  const stack = new charts.Stack(place, (time) => tell("moment", { track: number(), time }));
  root.classList.add("live");
  for (const track of data.tracks) {
    for (const [key, { codes, scale }] of Object.entries(track.arrays)) track.arrays[key] = charts.decoded(codes, scale, track.time.length);
  }
  root.tracks = data.tracks;
  for (const box of root.querySelectorAll("[data-channel], [data-line], [data-panel]")) box.addEventListener("change", build);
  if (one("track")) one("track").addEventListener("change", () => { build(); tell("track", { track: number() }); });
  root.addEventListener("go", (e) => {
    if (one("track") && number() !== e.detail.track) { one("track").value = e.detail.track; build(); }
    stack.go(e.detail.time);
  });
  build();

  function number() { return one("track") ? +one("track").value : 0; }

  function values(track, line, channel) {
    const of = track.arrays[line.of];
    if (!of) return null;
    if (!line.minus) return of[channel];
    const minus = track.arrays[line.minus];
    return minus ? of[channel].map((v, t) => (v == null || minus[channel][t] == null ? null : v - minus[channel][t])) : null;
  }

  function build() {
    const track = data.tracks[number()], on = new Set(checked("line").map((k) => data.lines[k])), panels = checked("panel");
    const specs = [];
    place.style.setProperty("--columns", Math.min(2, panels.length || 1));
    for (const channel of checked("channel")) for (const p of panels.length ? panels : data.panels.map((_, i) => i)) {
      const panel = data.panels[p];
      const lines = panel.lines.filter((line) => on.has(line.label) && values(track, line, channel));
      if (!lines.length) continue;
      specs.push({
        title: `${data.channels[channel]}: ${panel.name}`, unit: panel.unit, prefixed: panel.prefixed, lines, bands: track.bands,
        data: [track.time, ...lines.map((line) => values(track, line, channel))],
      });
    }
    stack.show(specs);
    place.hidden = !specs.length;
  }
}
