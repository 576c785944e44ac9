// SPDX-License-Identifier: Apache-2.0
// Switches the theme, as on the report's page.
(function () {
  "use strict";
  var root = document.documentElement;
  var systemDark = matchMedia("(prefers-color-scheme: dark)");
  var button = document.getElementById("~theme");
  function isDark() { return root.dataset.theme ? root.dataset.theme === "dark" : systemDark.matches; }
  function changed() { button.textContent = isDark() ? "Light theme" : "Dark theme"; }
  button.hidden = false;
  button.addEventListener("click", function () {
    root.dataset.theme = isDark() ? "light" : "dark";
    try { localStorage.setItem("hil-theme", root.dataset.theme); } catch (e) { /* private window */ }
    changed();
  });
  systemDark.addEventListener("change", changed);
  changed();
})();
