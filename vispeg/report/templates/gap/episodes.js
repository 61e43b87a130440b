"use strict";
// Two policies, or one in two worlds, on the same seeds: one square per episode.
for (const root of document.querySelectorAll("[data-pairing]")) {
  const data = JSON.parse(root.querySelector("[data-episodes]").textContent), one = (name) => root.querySelector(`[data-${name}]`);
  const choices = [0, 1].map((side) => ["policy", "world"].map((of) => root.querySelector(`[data-${of}-of="${side}"]`)));
  const squares = one("squares"), made = (tag, text) => Object.assign(document.createElement(tag), { textContent: text });
  let list = [], current = 0;

  for (const pair of choices) for (const select of pair) select.addEventListener("change", build);
  squares.addEventListener("click", (e) => { const k = list.indexOf(e.target.closest("button")); if (k >= 0) { move(k); tell(k); } });
  squares.addEventListener("keydown", (e) => {
    const wide = Math.max(1, list.filter((b) => b.offsetTop === list[0].offsetTop).length);
    const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -wide, ArrowDown: wide, Home: -list.length, End: list.length }[e.key];
    if (!step) return;
    e.preventDefault();
    move(Math.min(list.length - 1, Math.max(0, current + step)));
    list[current].focus();
    tell(current);
  });
  build();

  function sides() { return choices.map(([policy, world]) => ({ policy: +policy.value, world: +world.value })); }
  function row(side) { return data.rows[side.policy + "," + side.world]; }
  function called(side) { return `${data.names[side.policy]} in ${data.worlds[side.world]}`; }

  function build() {
    const both = sides(), rows = both.map(row), counts = [0, 0, 0, 0], used = new Set();
    squares.replaceChildren();
    list = [];
    current = 0;
    one("episode").textContent = "";
    if (rows.some((r) => !r)) { one("counts").textContent = "One of the two was not played there."; return; }
    data.seeds.forEach((seed, k) => {
      const ends = rows.map((r) => r.end[k]);
      if (ends.some((end) => end == null)) return;
      counts[(ends[0] ? 2 : 0) + (ends[1] ? 1 : 0)]++;
      ends.forEach((end) => used.add(end));
      const button = document.createElement("button"), colour = ends.map((end) => `var(--${data.colours[end]})`);
      button.type = "button";
      button.tabIndex = list.length ? -1 : 0;
      button.dataset.at = k;
      button.style.background = `linear-gradient(to right, ${colour[0]} 50%, ${colour[1]} 50%)`;
      button.title = `seed ${seed}: ${ends.map((end) => data.ends[end]).join(", ")}`;
      button.setAttribute("aria-label", button.title);
      if (films(seed, both).length) button.classList.add("filmed");
      list.push(button);
    });
    squares.append(...list);
    const [all, first, second, none] = counts, n = list.length;
    one("counts").textContent = `${called(both[0])} and ${called(both[1])}, ${n} episodes: both succeed in ${all}, only the first in ${first}, only the second in ${second}, neither in ${none}.`;
    one("key").replaceChildren(...[...used].sort((a, b) => a - b).flatMap((end) => {
      const swatch = made("i", "");
      swatch.className = "swatch";
      swatch.style.background = `var(--${data.colours[end]})`;
      return [swatch, ` ${data.ends[end]}  `];
    }));
  }

  function move(k) {
    list[current].tabIndex = -1;
    list[current].removeAttribute("aria-current");
    current = k;
    list[k].tabIndex = 0;
    list[k].setAttribute("aria-current", "true");
  }

  function films(seed, both) {
    return both.flatMap((side) => data.films.filter((f) => f.seed === seed && f.policy === data.policies[side.policy] &&
      (f.trained == null || f.trained === data.trained[side.policy]) && f.world === data.worlds[side.world]));
  }

  function tell(i) {
    const k = +list[i].dataset.at, seed = data.seeds[k], both = sides(), parts = [made("b", `Seed ${seed}. `)];
    both.forEach((side) => {
      const r = row(side), more = [r.time[k] == null ? "" : `${r.time[k]} s`, r.force[k] == null ? "" : `at most ${r.force[k]} N`].filter(Boolean);
      parts.push(`${called(side)}: ${data.ends[r.end[k]]}${more.length ? ` (${more.join(", ")})` : ""}. `);
    });
    for (const at of new Set(films(seed, both).map((f) => f.at))) {
      const link = made("a", "Film");
      link.href = "#" + at;
      link.addEventListener("click", () => { document.getElementById(at).open = true; });
      parts.push(link, " ");
    }
    one("episode").replaceChildren(...parts);
  }
}
