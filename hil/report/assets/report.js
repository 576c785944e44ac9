// SPDX-License-Identifier: Apache-2.0
// Draws the charts, zooms them, switches the theme, follows deep links. All text is in the page
// already; nothing here inserts markup.
(function () {
  "use strict";
  var root = document.documentElement;
  var live = document.getElementById("~live");
  var data = JSON.parse(document.getElementById("~chart-data").textContent);
  var plots = [];
  var printing = false;

  function css(name) { return getComputedStyle(root).getPropertyValue(name).trim(); }

  // ---- theme ---------------------------------------------------------------------------------
  var systemDark = window.matchMedia("(prefers-color-scheme: dark)");
  var themeButton = document.getElementById("~theme");
  function isDark() { return root.dataset.theme ? root.dataset.theme === "dark" : systemDark.matches; }
  function themeChanged() {
    themeButton.textContent = isDark() ? "Light theme" : "Dark theme";
    plots.forEach(function (p) { p.u.redraw(false, true); });
  }
  themeButton.hidden = false;
  themeButton.addEventListener("click", function () {
    root.dataset.theme = isDark() ? "light" : "dark";
    try { localStorage.setItem("hil-theme", root.dataset.theme); } catch (e) { /* private window */ }
    themeChanged();
  });
  systemDark.addEventListener("change", themeChanged);

  // ---- numbers -------------------------------------------------------------------------------
  function unpack(packed) {
    if (packed.v) return packed.v;
    var out = [], sum = 0, i;
    if (packed.d) {
      for (i = 0; i < packed.d.length; i++) { sum += packed.d[i]; out.push(packed.o + sum * packed.s); }
    } else {
      for (i = 0; i < packed.k.length; i++) out.push(packed.k[i] === null ? null : packed.o + packed.k[i] * packed.s);
    }
    return out;
  }
  function decimalsFor(step) {
    for (var n = 0; n < 12; n++) if (Math.abs(step - +step.toFixed(n)) < step * 1e-6) return n;
    return 12;
  }
  function group(text) {
    var parts = text.replace("-", "\u2212").split(".");
    parts[0] = parts[0].replace(/(\d)(?=(\d{3})+$)/g, "$1\u202f");
    return parts.join(".");
  }
  function tickLabels(u, ticks, axis, space, step) {
    return ticks.map(function (v) {
      if (v === null) return "";
      if (Math.abs(v) >= 1e6 || (v !== 0 && Math.abs(v) < 1e-4)) return v.toExponential(0).replace("-", "\u2212");
      return group(v.toFixed(decimalsFor(step || Math.abs(v) || 1)));
    });
  }
  function logLabels(u, ticks) {
    return ticks.map(function (v) {
      if (v === null) return "";
      var power = Math.log10(v);
      if (Math.abs(power - Math.round(power)) > 1e-9) return "";
      return v >= 1e-3 && v < 1e5 ? group(String(+v.toPrecision(1))) : "1e" + String(Math.round(power)).replace("-", "\u2212");
    });
  }
  // Of a span of many decades only whole ones are ruled.
  function decades(u, ticks) {
    return ticks.map(function (v) { var p = Math.log10(v); return Math.abs(p - Math.round(p)) < 1e-9 ? v : null; });
  }
  function every(u, ticks) { return ticks; }
  function reading(v, unit) {
    var size = Math.abs(v), digits = size === 0 ? 0 : Math.max(0, 4 - Math.floor(Math.log10(size)));
    return group(v.toFixed(Math.min(9, digits))) + (unit ? " " + unit : "");
  }

  // ---- drawing -------------------------------------------------------------------------------
  function columns(chart) {
    var tables = chart.traces.map(function (trace) {
      var x = unpack(trace.x || chart.traces[0].x), y = unpack(trace.y);
      if (chart.yLog) {
        var keep = x.map(function (v, i) { return y[i] === null || y[i] > 0; });
        x = x.filter(function (_, i) { return keep[i]; });
        y = y.filter(function (_, i) { return keep[i]; });
      }
      return [x, y];
    });
    return tables.length > 1 ? uPlot.join(tables) : tables[0];
  }

  function yRange(chart) {
    return function (u, low, high) {
      if (low === null || high === null) return chart.yLog ? [1, 10] : [0, 1];
      if (chart.yLog) {
        chart.limits.forEach(function (l) {
          if (l.value > 0 && l.value < high * 100 && l.value > low / 100) { low = Math.min(low, l.value); high = Math.max(high, l.value); }
        });
        return [Math.pow(10, Math.floor(Math.log10(low))), Math.pow(10, Math.ceil(Math.log10(high)))];
      }
      var span = high - low || Math.abs(high) || 1;
      // A limit is kept in view unless it would squash the trace into a line.
      chart.limits.forEach(function (l) {
        if (l.value - high < 3 * span && low - l.value < 3 * span) { low = Math.min(low, l.value); high = Math.max(high, l.value); }
      });
      span = high - low || 1;
      var rim = chart.limits.length ? 0.11 : 0.06;
      return [low - span * rim, high + span * rim];
    };
  }

  function drawLimits(chart) {
    return function (u) {
      var c = u.ctx, box = u.bbox, dpr = uPlot.pxRatio;
      var low = u.scales.y.min, high = u.scales.y.max;
      c.save();
      c.beginPath(); c.rect(box.left, box.top, box.width, box.height); c.clip();
      c.font = "600 " + 11 * dpr + "px system-ui, sans-serif";
      c.strokeStyle = c.fillStyle = css("--fail");
      c.lineWidth = 1.5 * dpr;
      chart.limits.forEach(function (limit) {
        var upper = limit.side === "above", text = limit.label;
        c.textAlign = "right";
        if (limit.value < low || limit.value > high) {
          c.fillStyle = css("--fail");
          c.textBaseline = limit.value > high ? "top" : "bottom";
          label(c, text + (limit.value > high ? " \u2191 above" : " \u2193 below"), box.left + box.width - 6 * dpr,
            limit.value > high ? box.top + 4 * dpr : box.top + box.height - 4 * dpr, dpr);
          return;
        }
        var y = u.valToPos(limit.value, "y", true);
        c.fillStyle = css("--shade");
        if (upper) c.fillRect(box.left, box.top, box.width, y - box.top);
        else c.fillRect(box.left, y, box.width, box.top + box.height - y);
        c.setLineDash([6 * dpr, 4 * dpr]);
        c.beginPath(); c.moveTo(box.left, y); c.lineTo(box.left + box.width, y); c.stroke();
        c.fillStyle = css("--fail");
        var above = upper ? y - box.top > 16 * dpr : box.top + box.height - y < 16 * dpr;
        c.textBaseline = above ? "bottom" : "top";
        label(c, text, box.left + box.width - 6 * dpr, y + (above ? -3 : 3) * dpr, dpr);
      });
      c.restore();
    };
  }
  // A limit's words stay readable on top of a trace.
  function label(c, text, x, y, dpr) {
    c.save();
    c.setLineDash([]);
    c.lineJoin = "round"; c.lineWidth = 4 * dpr; c.strokeStyle = css("--card");
    c.strokeText(text, x, y);
    c.fillText(text, x, y);
    c.restore();
  }
  function series(chart) {
    return chart.traces.map(function (trace, n) {
      var colour = function () { return css("--s" + n % 8); };
      var s = { label: trace.label, stroke: colour, width: 1.5 };
      if (trace.kind === "edge") {
        // Bounds a band and is not drawn itself.
        s.stroke = "transparent";
        s.points = { show: false };
      } else if (trace.kind === "points") {
        s.paths = function () { return null; };
        s.points = { show: true, size: 4, width: 0, fill: colour, stroke: colour };
      } else {
        s.points = { show: false };
      }
      return s;
    });
  }

  // Spans of time behind the traces, and on the upper edge of the plot.
  function drawSpans(chart) {
    return function (u) {
      var c = u.ctx, box = u.bbox, thick = 4 * uPlot.pxRatio;
      c.save();
      c.beginPath(); c.rect(box.left, box.top, box.width, box.height); c.clip();
      (chart.spans || []).forEach(function (span) {
        var a = u.valToPos(span.from, "x", true), b = u.valToPos(span.to, "x", true);
        c.fillStyle = css("--" + span.kind);
        c.fillRect(a, box.top, Math.max(b - a, 1), span.kind === "repetition" ? thick : box.height);
      });
      c.restore();
    };
  }
  function bandsOf(chart) {
    return (chart.bands || []).map(function (band) {
      return { series: band.series, fill: function () { return css("--s" + band.colour % 8) + "38"; } };
    });
  }

  function create(holder) {
    var chart = data[holder.dataset.chart];
    if (!chart) return;
    var figure = holder.closest("figure");
    var readout = figure.querySelector(".readout");
    var columnsOf = columns(chart);
    var x = columnsOf[0];
    var whole = { min: x[0], max: x[x.length - 1] };
    if (!(whole.max > whole.min)) whole = { min: whole.min - 0.5, max: whole.min + 0.5 };
    var ink = function () { return css("--ink-2"); }, grid = function () { return css("--grid"); };
    var fonts = { font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    function axis(text, log, more) {
      return Object.assign({ label: text || undefined, labelSize: 20, labelGap: 2, stroke: ink, grid: { stroke: grid, width: 1, filter: log ? decades : every },
        ticks: { stroke: grid, width: 1, size: 5, filter: log ? decades : every }, values: log ? logLabels : tickLabels }, fonts, more);
    }
    var u = new uPlot({
      width: Math.max(200, holder.clientWidth),
      height: 260,
      legend: { show: false },
      pxAlign: 0,
      padding: [8, 10, 0, 0],
      cursor: {
        y: false,
        drag: { x: true, y: false, dist: 6 },
        points: { size: 7 },
        sync: chart.group ? { key: chart.group, setSeries: false } : undefined,
        bind: { dblclick: function () { return function () { zoom(plot, plot.whole); return null; }; } }
      },
      scales: {
        x: { time: false, range: function (_, low, high) { return [low, high]; } },
        y: { distr: chart.yLog ? 3 : 1, range: yRange(chart) }
      },
      axes: [
        axis(chart.xLabel, false, { space: 60, size: 30 }),
        axis("", chart.yLog, { space: 34, size: function (u, values) {
          var longest = (values || []).reduce(function (n, v) { return Math.max(n, String(v).length); }, 1);
          return Math.max(58, 14 + 7.2 * longest);
        } })
      ],
      series: [{}].concat(series(chart)),
      bands: bandsOf(chart),
      hooks: {
        drawClear: [drawSpans(chart)],
        draw: [drawLimits(chart)],
        setCursor: [function (u) { show(u, chart, readout); }],
        setScale: [function (u, key) {
          if (key !== "x") return;
          var at = u.scales.x;
          figure.dataset.xMin = at.min; figure.dataset.xMax = at.max;
          if (at.max - at.min < (whole.max - whole.min) * 0.999) figure.dataset.zoomed = "yes"; else delete figure.dataset.zoomed;
          if (plot && plot.ready) follow(plot);
        }]
      }
    }, columnsOf, holder);
    var plot = { u: u, holder: holder, chart: chart, figure: figure, whole: whole, ready: false };
    plots.push(plot);
    var peer = plots.find(function (p) { return p !== plot && chart.group && p.chart.group === chart.group; });
    var now = peer && peer.holder.closest("figure").dataset.zoomed ? peer.u.scales.x : whole;
    u.setScale("x", { min: now.min, max: now.max });
    // The library sets scales in a microtask; only what a person does after that moves the others.
    requestAnimationFrame(function () { plot.ready = true; });
    figure.dataset.drawn = "yes";
    bind(plot);
    return plot;
  }

  function show(u, chart, readout) {
    var i = u.cursor.idx;
    if (i === null || i === undefined || u.cursor.left < 0) { readout.textContent = "\u00a0"; return; }
    readout.textContent = words(u, chart, i);
  }
  function words(u, chart, i) {
    var parts = [reading(u.data[0][i], chart.xUnit)];
    chart.traces.forEach(function (trace, n) {
      var v = u.data[n + 1][i];
      if (v === null || v === undefined) return;
      var value = reading(v, chart.yUnit);
      parts.push(chart.traces.length > 1 ? trace.label + " " + value : value);
    });
    return parts.join("  \u00b7  ");
  }

  // ---- zoom ----------------------------------------------------------------------------------
  function zoom(plot, range) {
    var whole = plot.whole, span = Math.min(range.max - range.min, whole.max - whole.min);
    span = Math.max(span, (whole.max - whole.min) * 1e-4);
    var min = Math.min(Math.max(range.min, whole.min), whole.max - span);
    plot.u.setScale("x", { min: min, max: min + span });
  }
  // Timelines of one run on one clock move together.
  function follow(plot) {
    var s = plot.u.scales.x, slack = (s.max - s.min) * 1e-6;
    if (!plot.chart.group) return;
    plots.forEach(function (other) {
      if (other === plot || other.chart.group !== plot.chart.group) return;
      var o = other.u.scales.x;
      var there = Math.abs(o.min - s.min) <= slack && Math.abs(o.max - s.max) <= slack;
      if (!there) other.u.setScale("x", { min: s.min, max: s.max });
    });
  }
  function act(plot, what) {
    var s = plot.u.scales.x, a = s.min, b = s.max, span = b - a, middle = (a + b) / 2;
    if (what === "in") zoom(plot, { min: middle - span / 4, max: middle + span / 4 });
    if (what === "out") zoom(plot, { min: middle - span, max: middle + span });
    if (what === "left") zoom(plot, { min: a - span / 4, max: b - span / 4 });
    if (what === "right") zoom(plot, { min: a + span / 4, max: b + span / 4 });
    if (what === "reset") zoom(plot, plot.whole);
    live.textContent = "Shows " + reading(s.min, plot.chart.xUnit) + " to " + reading(s.max, plot.chart.xUnit);
  }
  function read(plot, step) {
    var u = plot.u, x = u.data[0], s = u.scales.x, i = u.cursor.idx;
    if (i === null || i === undefined || u.cursor.left < 0) i = u.valToIdx((s.min + s.max) / 2) - step;
    i = Math.min(Math.max(i + step, 0), x.length - 1);
    if (x[i] < s.min || x[i] > s.max) return;
    u.setCursor({ left: u.valToPos(x[i], "x"), top: 0 });
    live.textContent = words(u, plot.chart, i);
  }
  var keys = { "+": "in", "=": "in", "-": "out", "_": "out", "0": "reset", "Home": "reset", "Escape": "reset", "ArrowLeft": "left", "ArrowRight": "right" };

  function bind(plot) {
    plot.holder.addEventListener("keydown", function (event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.shiftKey && (event.key === "ArrowLeft" || event.key === "ArrowRight")) {
        read(plot, event.key === "ArrowLeft" ? -1 : 1);
      } else if (keys[event.key]) act(plot, keys[event.key]);
      else return;
      event.preventDefault();
    });
    var tools = plot.figure.querySelector(".tools");
    tools.hidden = false;
    tools.addEventListener("click", function (event) {
      var button = event.target.closest("button");
      if (button) act(plot, button.dataset.do);
    });
    bindTouch(plot);
    new ResizeObserver(function () {
      var width = Math.max(200, plot.holder.clientWidth);
      if (!printing && width !== plot.u.width) plot.u.setSize({ width: width, height: plot.u.height });
    }).observe(plot.holder);
  }

  // Two fingers zoom, one finger moves what is zoomed; up and down scroll the page as ever.
  function bindTouch(plot) {
    var fingers = new Map(), over = plot.u.over;
    function position(event) {
      var box = over.getBoundingClientRect();
      return { x: event.clientX - box.left, width: box.width };
    }
    function spread() { var p = Array.from(fingers.values()); return Math.max(20, Math.abs(p[0].x - p[1].x)); }
    over.addEventListener("pointerdown", function (event) {
      if (event.pointerType === "touch") fingers.set(event.pointerId, position(event));
    });
    over.addEventListener("pointermove", function (event) {
      if (!fingers.has(event.pointerId)) return;
      var before = fingers.get(event.pointerId), now = position(event), s = plot.u.scales.x, span = s.max - s.min;
      if (fingers.size === 1) {
        var shift = (before.x - now.x) / now.width * span;
        fingers.set(event.pointerId, now);
        zoom(plot, { min: s.min + shift, max: s.max + shift });
      } else {
        var wide = spread();
        fingers.set(event.pointerId, now);
        var centre = Array.from(fingers.values()).reduce(function (sum, p) { return sum + p.x; }, 0) / fingers.size;
        var at = s.min + centre / now.width * span, next = span * wide / spread();
        zoom(plot, { min: at - (at - s.min) / span * next, max: at + (s.max - at) / span * next });
      }
    });
    ["pointerup", "pointercancel", "pointerleave"].forEach(function (kind) {
      over.addEventListener(kind, function (event) { fingers.delete(event.pointerId); });
    });
  }

  // ---- deep links ----------------------------------------------------------------------------
  function goTo() {
    var id;
    try { id = decodeURIComponent(location.hash.slice(1)); } catch (e) { return; }
    var target = id && document.getElementById(id);
    document.querySelectorAll(".target").forEach(function (e) { e.classList.remove("target"); });
    if (!target) return;
    for (var e = target; e; e = e.parentElement) if (e.tagName === "DETAILS") e.open = true;
    target.classList.add("target");
    target.scrollIntoView({ block: target.matches("tr, figure") ? "center" : "start" });
    if (target.tabIndex >= -1) target.focus({ preventScroll: true });
  }
  window.addEventListener("hashchange", goTo);

  // ---- printing ------------------------------------------------------------------------------
  var themeBefore, folded = [];
  window.addEventListener("beforeprint", function () {
    drawAll();
    // Every check and every line's arithmetic; what lies deeper would make a book of it.
    folded = Array.from(document.querySelectorAll("details.group:not([open]), .budget details:not([open])"));
    folded.forEach(function (e) { e.open = true; });
    printing = true;
    themeBefore = root.dataset.theme;
    root.dataset.theme = "light";
    plots.forEach(function (p) { p.u.setSize({ width: 660, height: 215 }); p.u.redraw(false, true); });
  });
  window.addEventListener("afterprint", function () {
    printing = false;
    folded.forEach(function (e) { e.open = false; });
    if (themeBefore) root.dataset.theme = themeBefore; else delete root.dataset.theme;
    plots.forEach(function (p) { p.u.setSize({ width: Math.max(200, p.holder.clientWidth), height: 260 }); });
    themeChanged();
  });

  // ---- start: what is near the window first ----------------------------------------------------
  var waiting = Array.from(document.querySelectorAll("[data-chart]"));
  var watcher = new IntersectionObserver(function (entries) {
    entries.forEach(function (entry) { if (entry.isIntersecting) start(entry.target); });
  }, { rootMargin: "600px" });
  function start(holder) {
    var at = waiting.indexOf(holder);
    if (at < 0) return;
    waiting.splice(at, 1);
    watcher.unobserve(holder);
    create(holder);
  }
  function drawAll() { waiting.slice().forEach(start); }
  waiting.forEach(function (holder) { watcher.observe(holder); });
  themeChanged();
  goTo();
})();
