// Runs once a window. It types what the system says of light and dark into the field whose label is for
// `data-target`, and hides that field; and it names what the toolkit leaves without a name for a screen reader.
const target = this.dataset.target;
const dark = matchMedia('(prefers-color-scheme: dark)');
const rowOf = (label) => {
  let row = label;
  while (row && !row.querySelector('input, [role=slider]')) row = row.parentElement;
  return row && row.querySelectorAll('label[for]').length === 1 ? row : null;
};
let told = false;
const tell = () => {
  const row = rowOf(document.querySelector('label[for="' + target + '"]'));
  if (!row) return;
  row.style.display = 'none';
  const field = row.querySelector('input');
  const value = (dark.matches ? 'dark ' : 'light ') + Math.random();
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(field, value);
  field.dispatchEvent(new Event('input', { bubbles: true }));
  told = true;
};
const named = (element, name) => {
  if (!element.getAttribute('aria-label') && !(element.labels && element.labels.length)) {
    element.setAttribute('aria-label', name);
  }
};
const bars = () => document.querySelectorAll('[role=progressbar]').forEach((e) => named(e, 'working'));
const name = () => {
  if (!told) tell();
  for (const label of document.querySelectorAll('label[for]')) {
    const row = rowOf(label);
    if (row) row.querySelectorAll('input:not([type=hidden]), [role=slider]').forEach((e) => named(e, label.textContent));
  }
  document.querySelectorAll('[aria-label^="Expand panel"]').forEach((e) => {
    const label = 'Expand panel ' + e.innerText.replace(/\s+/g, ' ').trim();
    if (e.getAttribute('aria-label') !== label) e.setAttribute('aria-label', label);
  });
  document.querySelectorAll('button').forEach((e) => {
    if (!e.textContent.trim()) named(e, /Close/.test(e.className) ? 'close' : 'more');
  });
};
const lead = () => { // to the second panel, where there is one
  const there = document.querySelector('.mantine-Tabs-root') !== null;
  document.querySelectorAll('.vp.below').forEach((e) => { if (e.hidden === there) e.hidden = !there; });
};
let waits = false;
const later = () => {
  if (waits) return;
  waits = true;
  setTimeout(() => { waits = false; name(); lead(); }, 200);
};
bars();
name();
lead();
dark.addEventListener('change', tell);
// a bar comes and goes while a page works: it has its name at once, the rest a moment later
new MutationObserver(() => { bars(); later(); }).observe(document.body, { childList: true, subtree: true });
