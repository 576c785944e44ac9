// SPDX-License-Identifier: Apache-2.0
// Takes frames from the server, keeps the last seconds, draws once per animation frame and says
// which frame was drawn. All text goes in as text; nothing here inserts markup.
(function () {
  "use strict";
  var SPANS_S = { velocity: window.innerWidth >= 900 ? 20 : 12, imu: 10 };
  var RETRY_MS = [300, 600, 1200, 2500, 5000];
  var page = document.documentElement;
  var socket = null, tries = 0, drawn = 0, newest = 0, due = false, asleep = false;
  var t = null, about = null, reps = null, health = null, node = "leader";
  var points = fresh();
  var counted = null;

  function fresh() { return { velocity: [], imu: { leader: [], follower: [] } }; }
  function $(id) { return document.getElementById(id); }
  function say(element, text) { if (element.textContent !== text) element.textContent = text; }
  function fixed(value, digits) {
    if (value === null || value === undefined) return "–";
    var text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
  }
  function chip(id, level, text) {
    var element = $(id);
    if (element.dataset.level !== level) element.dataset.level = level;
    say(element.querySelector(".text"), text);
  }
  function css(name) { return getComputedStyle(page).getPropertyValue(name).trim(); }

  // ---- charts --------------------------------------------------------------------------------
  var INK = css("--ink-2"), GRID = "#1f2932";
  function label(u, ticks) {
    return ticks.map(function (v) { return v === 0 ? "now" : String(v).replace("-", "−") + " s"; });
  }
  function chart(id, title, colours, span, least, hook) {
    var box = $(id);
    var top = least;
    var font = "12px " + css("--sans");
    var options = {
      width: Math.max(box.clientWidth, 50), height: Math.max(box.clientHeight, 50),
      legend: { show: false }, cursor: { show: false }, select: { show: false },
      padding: [10, 14, 0, 0],
      scales: { x: { time: false, range: function () { return [-span, 0]; } },
                y: { range: function () { return [-top, top]; } } },
      axes: [
        { stroke: INK, font: font, size: 26, space: 60, values: label, grid: { stroke: GRID, width: 1 }, ticks: { show: false } },
        { stroke: INK, font: font, size: 46, space: 26, label: title, labelSize: 18, labelFont: font, labelGap: 0,
          values: function (u, ticks) { return ticks.map(function (v) { return String(v).replace("-", "−"); }); },
          grid: { stroke: GRID, width: 1 }, ticks: { show: false } }
      ],
      series: [{}].concat(colours.map(function (c) { return { stroke: css(c), width: colours.length > 1 ? 1.25 : 2, points: { show: false } }; })),
      hooks: hook ? { drawAxes: [hook] } : {}
    };
    var empty = [[]].concat(colours.map(function () { return []; }));
    var plot = new uPlot(options, empty, box);
    new ResizeObserver(function () {
      if (box.clientWidth > 50 && box.clientHeight > 50) plot.setSize({ width: box.clientWidth, height: box.clientHeight });
    }).observe(box);
    return function (rows, first) {
      var data = [rows.map(function (r) { return r[0] - t; })];
      var most = 0, i, k, column;
      for (k = 0; k < colours.length; k++) {
        column = new Array(rows.length);
        for (i = 0; i < rows.length; i++) {
          column[i] = rows[i][first + k];
          if (Math.abs(column[i]) > most) most = Math.abs(column[i]);
        }
        data.push(column);
      }
      top = nice(Math.max(most, least));
      plot.setData(data);
    };
  }
  function nice(most) {
    var unit = Math.pow(10, Math.floor(Math.log10(most)));
    var steps = [1, 1.5, 2, 3, 4, 5, 6, 8, 10], i;
    for (i = 0; i < steps.length; i++) if (most <= steps[i] * unit * 1.0001) return steps[i] * unit;
    return 10 * unit;
  }
  // Where the repetitions were, behind the curve.
  function marks(u) {
    if (!reps || t === null) return;
    var c = u.ctx, b = u.bbox;
    c.save();
    c.beginPath(); c.rect(b.left, b.top, b.width, b.height); c.clip();
    reps.repetitions.forEach(function (r, i) {
      if (r.end_s < t - SPANS_S.velocity || r.start_s > t) return;
      var x0 = u.valToPos(r.start_s - t, "x", true), x1 = u.valToPos(r.end_s - t, "x", true);
      c.fillStyle = "rgba(91, 224, 190, 0.13)";
      c.fillRect(x0, b.top, x1 - x0, b.height);
      c.fillStyle = "#a9b7c4";
      c.font = "600 " + Math.round(13 * devicePixelRatio) + "px " + css("--sans");
      c.textAlign = "center"; c.textBaseline = "bottom";
      c.fillText(String(reps.first + i), (x0 + x1) / 2, b.top + b.height - 3 * devicePixelRatio);
    });
    c.restore();
  }
  var draw = {
    velocity: chart("velocity", "m/s", ["--velocity"], SPANS_S.velocity, 1, marks),
    accel: chart("accel", "m/s²", ["--x", "--y", "--z"], SPANS_S.imu, 15),
    gyro: chart("gyro", "°/s", ["--x", "--y", "--z"], SPANS_S.imu, 50)
  };

  // ---- text ----------------------------------------------------------------------------------
  function showAbout() {
    page.dataset.kind = about.kind;
    say($("label"), about.label);
    say($("title"), about.title);
    say($("note"), about.note);
    document.title = about.label + " · bar velocity, live";
  }
  function showRepetitions() {
    var list = reps.repetitions, last = list[list.length - 1];
    say($("count"), String(reps.count));
    $("count").classList.toggle("long", reps.count > 99);
    var notes = [];
    if (reps.partial) notes.push("and " + reps.partial + " partial");
    if (reps.before) notes.push("set before: " + reps.before.count);
    say($("count-note"), notes.join(", "));
    say($("mean"), last ? fixed(last.mean_mps, 2) : "–");
    $("mean").classList.toggle("none", !last);
    say($("mean-note"), !last ? (reps.before ? "best of the set before: " + fixed(reps.before.best_mps, 2) : "")
      : last.kind === "partial" ? "partial repetition" : "best of the set: " + fixed(reps.best_mps, 2));
    say($("peak"), last ? fixed(last.peak_mps, 2) : "–");
    say($("loss"), fixed(reps.loss_percent, 0));
    say($("range"), last && last.range_m !== null ? fixed(100 * last.range_m, 0) : "–");
    say($("tilt"), last ? fixed(last.tilt_deg, 1) : "–");
    $("bars-none").hidden = list.length > 0;
    $("bars").hidden = list.length === 0;
    var most = Math.max.apply(null, list.map(function (r) { return r.mean_mps; }).concat([0.01]));
    $("bars").replaceChildren.apply($("bars"), list.map(function (r, i) {
      var item = document.createElement("li");
      var value = item.appendChild(document.createElement("span"));
      var bar = item.appendChild(document.createElement("span"));
      var number = item.appendChild(document.createElement("span"));
      if (r.kind === "partial") item.className = "partial";
      value.className = "value"; value.textContent = fixed(r.mean_mps, 2);
      bar.className = "bar"; bar.style.height = "calc((100% - 2.4rem) * " + (r.mean_mps / most).toFixed(3) + ")";
      number.className = "number"; number.textContent = (r.kind === "partial" ? "½ " : "") + (reps.first + i);
      return item;
    }));
    $("bars").scrollLeft = $("bars").scrollWidth;
    var all = reps.count + reps.partial;
    if (counted !== null && all > counted && last) {
      [".count", ".mean"].forEach(function (name) {
        var card = document.querySelector(name);
        card.classList.remove("fresh"); void card.offsetWidth; card.classList.add("fresh");
      });
      say($("said"), "Repetition " + reps.count + ", " + fixed(last.mean_mps, 2) + " metres per second" + (last.kind === "partial" ? ", partial" : ""));
    }
    counted = all;
  }
  function showHealth() {
    chip("overall", health.level, health.state);
    $("faults").replaceChildren.apply($("faults"), health.faults.map(function (f) {
      var item = document.createElement("li");
      item.textContent = "✕ " + f.role.charAt(0).toUpperCase() + f.role.slice(1) + ": " + f.words;
      var small = item.appendChild(document.createElement("small"));
      small.textContent = "at " + fixed(f.t_s, 1) + " s: " + f.detail;
      return item;
    }));
    var box = $("rows");
    while (box.children.length > health.rows.length) box.lastElementChild.remove();
    health.rows.forEach(function (row, i) {
      var line = box.children[i];
      if (!line) {
        line = box.appendChild(document.createElement("div"));
        var term = document.createElement("dt"), text = document.createElement("dd"), sign = document.createElement("dt");
        sign.className = "sign";
        line.append(sign, term, text);
        text.append(document.createElement("b"), document.createElement("span"));
        sign.appendChild(document.createElement("span")).className = "sr";
      }
      if (line.dataset.level !== row.level) line.dataset.level = row.level;
      say(line.children[0].firstElementChild, row.state);
      say(line.children[1], row.title);
      say(line.children[2].firstElementChild, row.value);
      say(line.children[2].lastElementChild, row.words);
    });
    showConnection();
  }
  function showConnection() {
    if (!socket || socket.readyState !== WebSocket.OPEN) return;
    if (!health) chip("connection", "unknown", "Connecting");
    else if (health.ended) chip("connection", "unknown", "Ended");
    else if (health.port === "lost") chip("connection", "bad", "Disconnected");
    else if (health.port === "waiting") chip("connection", "unknown", "Waiting for a port");
    else if (health.resting) chip("connection", "ok", "Resting");
    else chip("connection", "ok", "Connected");
    document.body.classList.toggle("old", health !== null && health.port === "lost");
  }

  // ---- frames --------------------------------------------------------------------------------
  function keep(list, more, span) {
    if (more) Array.prototype.push.apply(list, more);
    var oldest = t - span - 1, gone = 0;
    while (gone < list.length && list[gone][0] < oldest) gone++;
    if (gone) list.splice(0, gone);
  }
  function take(frame) {
    newest = frame.n;
    if (frame.about) { about = frame.about; points = fresh(); counted = null; showAbout(); }
    if (frame.t !== null) t = frame.t;
    keep(points.velocity, frame.velocity, SPANS_S.velocity);
    ["leader", "follower"].forEach(function (role) {
      keep(points.imu[role], frame.imu && frame.imu[role], SPANS_S.imu);
    });
    if (frame.repetitions) { reps = frame.repetitions; showRepetitions(); }
    if (frame.health) { health = frame.health; showHealth(); }
    say($("now"), fixed(frame.v, 2));
    if (!due) { due = true; requestAnimationFrame(render); }
  }
  function render() {
    due = false;
    if (t !== null) {
      draw.velocity(points.velocity, 1);
      draw.accel(points.imu[node], 1);
      draw.gyro(points.imu[node], 4);
    }
    if (newest > drawn && socket && socket.readyState === WebSocket.OPEN) {
      drawn = newest;
      socket.send(String(drawn));
    }
  }

  // ---- connection ----------------------------------------------------------------------------
  function connect() {
    socket = new WebSocket("ws://" + location.host + "/frames");
    drawn = newest = 0;
    // What the server before said of itself says nothing of this one.
    health = null;
    socket.onopen = function () { tries = 0; showConnection(); };
    socket.onmessage = function (event) { take(JSON.parse(event.data)); };
    socket.onclose = lost;
  }
  function lost() {
    chip("connection", "bad", "Page cut off: trying again");
    var wait = RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)];
    setTimeout(function () {
      // A refusal cannot be told from a server that is gone, except by asking for a file.
      fetch("/icon.svg").then(function (answer) {
        if (answer.status === 403) chip("connection", "bad", "Not let in: open a new address");
        else connect();
      }, lost);
    }, wait);
  }

  // ---- hands ---------------------------------------------------------------------------------
  document.querySelectorAll("input[name=node]").forEach(function (input) {
    input.addEventListener("change", function () { node = input.value; render(); });
  });
  var full = $("full");
  function toggleFull() {
    if (document.fullscreenElement) document.exitFullscreen();
    else page.requestFullscreen().catch(function () { /* refused by the browser */ });
  }
  if (document.fullscreenEnabled) {
    full.hidden = false;
    full.addEventListener("click", toggleFull);
    document.addEventListener("keydown", function (event) {
      if (event.key.toLowerCase() === "f" && !event.ctrlKey && !event.metaKey && !event.altKey) toggleFull();
    });
  }
  // A screen that goes dark is of no use at a rack; browsers allow this on this machine or by TLS.
  function stayAwake() {
    if (navigator.wakeLock && !asleep && document.visibilityState === "visible") {
      navigator.wakeLock.request("screen").catch(function () { asleep = true; });
    }
  }
  document.addEventListener("visibilitychange", stayAwake);
  stayAwake();
  // A page from the address with the token: the token is spent, and the address need not show it.
  if (location.search) history.replaceState(null, "", "/");
  connect();
})();
