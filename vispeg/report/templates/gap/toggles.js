"use strict";
// Policies come and go in every list of bars and every table that marks its rows with them.
for (const box of document.querySelectorAll("[data-toggles] input")) box.addEventListener("change", () => {
  for (const other of document.querySelectorAll("[data-toggles] input")) if (other.value === box.value) other.checked = box.checked;
  for (const row of document.querySelectorAll(`[data-policy="${box.value}"]`)) row.hidden = !box.checked;
});
