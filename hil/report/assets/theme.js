// SPDX-License-Identifier: Apache-2.0
// Before the first paint, so that the page never flashes in the wrong theme.
(function () {
  var theme = null;
  try { theme = localStorage.getItem("hil-theme"); } catch (e) { theme = null; }
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
  document.documentElement.classList.add("js");
})();
