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
const every = (selector, change) => document.querySelectorAll(selector).forEach(change);
const atOnce = () => {
  every('[role=progressbar]', (e) => named(e, 'working'));
  every('img:not([alt])', (e) => { // its label stands above it
    const above = e.closest('[role=dialog]')?.querySelector('h2') ?? e.parentElement.previousElementSibling;
    e.alt = above?.textContent.trim() || 'picture';
  });
  every('[data-scrollarea-viewport]:not([tabindex])', (e) => { e.tabIndex = 0; }); // so that keys can scroll it
};
const name = () => {
  if (!told) tell();
  every('label[for]', (label) => {
    const row = rowOf(label);
    if (row) row.querySelectorAll('input:not([type=hidden]), [role=slider]').forEach((e) => named(e, label.textContent));
  });
  every('[aria-label^="Expand panel"]', (e) => {
    const label = 'Expand panel ' + e.innerText.replace(/\s+/g, ' ').trim();
    if (e.getAttribute('aria-label') !== label) e.setAttribute('aria-label', label);
  });
  every('button', (e) => {
    if (!e.textContent.trim()) named(e, /Close/.test(e.className) ? 'close' : 'more');
  });
};
const lead = () => { // to the second panel, where there is one
  const there = document.querySelector('.mantine-Tabs-root') !== null;
  every('.vp.below', (e) => { if (e.hidden === there) e.hidden = !there; });
};
let waits = false;
const later = () => {
  if (waits) return;
  waits = true;
  setTimeout(() => { waits = false; name(); lead(); }, 200);
};
atOnce();
name();
lead();
dark.addEventListener('change', tell);
// bars and pictures come and go while a page works: they have their names at once, the rest a moment later
new MutationObserver(() => { atOnce(); later(); }).observe(document.body, { childList: true, subtree: true });
