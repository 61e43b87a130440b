"use strict";
// Switches effects on and off, and shows the precomputed residuals of the chosen model.
for (const root of document.querySelectorAll("[data-explore]")) {
  const data = JSON.parse(root.querySelector("[data-choices]").textContent);
  const one = (name) => root.querySelector(`[data-${name}]`);
  const all = (name) => [...root.querySelectorAll(`[data-${name}]`)];
  const stack = new charts.Stack(one("plots"));
  let row = data.start, recording = 0, sharedScale = false, shown = [];

  for (const r of data.recordings) { // one row per model and joint
    const rows = charts.decoded(r.codes, r.scale, r.time.length), nj = data.joints.length;
    r.values = data.rows.map((_, i) => rows.slice(i * nj, (i + 1) * nj));
  }
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
    shown.forEach((joint, i) => stack.update(i, lines(joint), "· " + r.joints[joint] + " RMS"));
  }

  function lines(joint) {
    const r = data.recordings[recording];
    return sharedScale ? [r.time, r.values[0][joint], r.values[row][joint]] : [r.time, r.values[row][joint]];
  }

  function build() {
    shown = all("joint").filter((box) => box.checked).map((box) => +box.dataset.joint);
    const pens = [{ label: "residual", colour: "after" }];
    if (sharedScale) pens.unshift({ label: "first model", colour: "before", width: 0.8 });
    stack.show(shown.map((joint) => ({
      title: data.joints[joint] + ": residual", note: "· " + data.rows[row].joints[joint] + " RMS",
      unit: data.unit, prefixed: data.prefixed, lines: pens, data: lines(joint),
    })));
  }
}
