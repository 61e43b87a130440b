"use strict";
// Shows and hides policies in every list of bars and every table whose rows name them.
for (const box of document.querySelectorAll("[data-toggles] input")) box.addEventListener("change", () => {
  for (const other of document.querySelectorAll("[data-toggles] input")) if (other.value === box.value) other.checked = box.checked;
  for (const row of document.querySelectorAll(`[data-policy="${box.value}"]`)) row.hidden = !box.checked;
});
