"use strict";
/* Charts of a run: data come as one JSON object, numbers as base64; every word is put in as text, never as markup. */
(function () {
  const holder = document.getElementById("data");
  if (!holder) return;
  const run = JSON.parse(holder.textContent);
  const numbers = (text, Kind) => {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    const found = new Kind(bytes.buffer);
    for (let i = 0; i < found.length; i++) if (!Number.isFinite(found[i])) found[i] = NaN;
    return found;
  };
  const time = numbers(run.time, Float64Array);
  const cache = {};
  const column = name => (cache[name] = cache[name] || numbers(run.columns[name], Float32Array));
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const extreme = v => v !== 0 && (Math.abs(v) >= 1e6 || Math.abs(v) < 1e-5);
  const short = v => (v == null ? "" : extreme(v) ? v.toExponential(2) : String(+v.toPrecision(5)));
  /* Numbers of an axis: all written in the same way. */
  const ticks = vs => (vs.some(v => v != null && extreme(v)) ? vs.map(v => (v ? (+v.toPrecision(5)).toExponential() : v == null ? "" : "0")) : vs.map(short));
  /* A time, as exactly as a window of time can show it: clocks may count from long ago. */
  const clock = v => (v == null ? "" : +v.toFixed(Math.max(0, Math.min(9, Math.ceil(3 - Math.log10(shown[1] - shown[0]))))) + " s");
  const whole = [time[0], time[time.length - 1] > time[0] ? time[time.length - 1] : time[0] + 1];
  let shown = whole.slice();
  const charts = new Map();

  /* First point not before a time. */
  function since(t) {
    let low = 0, high = time.length;
    while (low < high) { const m = (low + high) >> 1; if (time[m] < t) low = m + 1; else high = m; }
    return low;
  }

  /* Where the points of a window so many pixels wide begin that share a pixel; where few do, each point stands for
     itself. One point beyond each border, to which curves lead. All charts of a width share the answer. */
  let asked = "", groups = [];
  function sharing(low, high, pixels) {
    const key = low + " " + high + " " + pixels;
    if (key === asked) return groups;
    const begin = Math.max(0, since(low) - 1), end = Math.min(time.length, since(high) + 2);
    const few = end - begin <= 4 * pixels, across = pixels / (high - low);
    asked = key; groups = [];
    for (let k = begin, last = NaN; k < end; k++) {
      const pixel = few ? k : Math.floor((time[k] - low) * across);
      if (pixel !== last) groups.push(k);
      last = pixel;
    }
    groups.push(end);
    return groups;
  }

  /* What of a chart's columns can be told apart there: of points that share a pixel least and greatest of each curve,
     in their order. */
  function told(columns, low, high, pixels) {
    const from = sharing(low, high, pixels), out = [[]], known = v => (v === v ? v : null);
    for (let g = 0; g + 1 < from.length; g++) {
      out[0].push(time[from[g]]);
      if (from[g + 1] - from[g] > 1) out[0].push(time[from[g + 1] - 1]);
    }
    for (const v of columns) {
      const one = [];
      for (let g = 0; g + 1 < from.length; g++) {
        const begin = from[g], end = from[g + 1];
        if (end - begin < 3) { for (let k = begin; k < end; k++) one.push(known(v[k])); continue; }
        let least = Infinity, most = -Infinity, first = 0, last = 0;
        for (let k = begin; k < end; k++) {
          const x = v[k];
          if (x < least) { least = x; first = k; }
          if (x > most) { most = x; last = k; }
        }
        if (least > most) one.push(null, null); else if (first < last) one.push(least, most); else one.push(most, least);
      }
      out.push(one);
    }
    return out;
  }

  /* Charts in sight follow with the next frame, the others when they come into sight. */
  const seen = new Set(), stale = new Set(), whole_of = new Map();
  let due = false;
  function follow(u) {
    const columns = whole_of.get(u);
    if (columns) u.setData(told(columns, shown[0], shown[1], Math.round(u.width * (devicePixelRatio || 1))), false);
    u.setScale("x", { min: shown[0], max: shown[1] });
  }
  function followed() {
    due = false;
    charts.forEach((u, box) => (seen.has(box) ? follow(u) : stale.add(box)));
  }
  function chosen(low, high) {
    const hair = 1e-9 * (whole[1] - whole[0]);
    if (Math.abs(low - shown[0]) > hair || Math.abs(high - shown[1]) > hair) show(low, high);
  }

  function show(low, high) {
    const least = (whole[1] - whole[0]) / Math.max(10, time.length);
    if (high - low < least) { const m = (low + high) / 2; low = m - least / 2; high = m + least / 2; }
    shown = [Math.max(whole[0], low), Math.min(whole[1], high)];
    if (!due) { due = true; requestAnimationFrame(followed); }
    document.getElementById("span").textContent = clock(shown[0]) + " to " + clock(shown[1]);
  }
  function zoom(factor) {
    const m = (shown[0] + shown[1]) / 2, h = (shown[1] - shown[0]) / 2 * factor;
    show(m - h, m + h);
  }
  function move(share) {
    const w = shown[1] - shown[0];
    const low = Math.min(Math.max(whole[0], shown[0] + share * w), whole[1] - w);
    show(low, low + w);
  }

  function drawn(chart) {
    const columns = [], series = [{ label: "t", value: (u, v) => clock(v) }], around = [];
    const add = (values, options) => { columns.push(values); series.push(Object.assign({ value: (u, v) => short(v), points: { show: false } }, options)); };
    for (const line of chart.lines) {
      const values = line.constant == null ? Float64Array.from(column(line.column), v => v * (line.times || 1))
        : new Float64Array(time.length).fill(line.constant);
      if (line.sigma) {
        const s = column(line.sigma), at = series.length;
        add(values.map((v, i) => v + 3 * s[i]), { label: "+3 sigma", stroke: colour("envelope"), paths: () => null });
        add(values.map((v, i) => v - 3 * s[i]), { label: "-3 sigma", stroke: colour("envelope"), paths: () => null });
        around.push(at);
      }
      const dots = line.kind === "dots";
      add(values, { label: line.label, stroke: colour(line.colour), width: time.length > 4000 ? 1 : 1.4, dash: line.dash ? [6, 4] : undefined,
        paths: dots ? () => null : line.kind === "steps" ? uPlot.paths.stepped({ align: 1 }) : undefined,
        spanGaps: line.kind === "steps",  // a bound holds where nothing was seen, too
        points: { show: false } });
    }
    return { columns, series, around };
  }

  /* Between an upper curve and the one after it. Where points are dense, a bar for each pixel: a path of as many teeth
     (the library's bands are one) costs a processor that draws ten times as much. */
  function envelopes(u, around) {
    const c = u.ctx, b = u.bbox, x = u.data[0], at = (v, scale) => u.valToPos(v, scale, true);
    c.save(); c.beginPath(); c.rect(b.left, b.top, b.width, b.height); c.clip();
    c.fillStyle = colour("envelope");
    for (const upper of around) {
      const high = u.data[upper], low = u.data[upper + 1];
      if (x.length > b.width) {
        let pixel = NaN, top = 0, bottom = 0;
        for (let k = 0; k <= x.length; k++) {
          const here = k < x.length ? Math.round(at(x[k], "x")) : NaN;
          if (here !== pixel) {
            if (bottom > top) c.fillRect(pixel, top, Math.min(2, here - pixel) || 1, bottom - top);
            pixel = here; top = Infinity; bottom = -Infinity;
          }
          if (k === x.length || high[k] == null || low[k] == null) continue;
          top = Math.min(top, at(high[k], "y")); bottom = Math.max(bottom, at(low[k], "y"));
        }
        continue;
      }
      for (let k = 0, end; k < x.length; k = end + 1) {
        end = k;
        while (end < x.length && high[end] != null && low[end] != null) end++;
        if (end === k) continue;
        c.beginPath();
        for (let m = k; m < end; m++) c.lineTo(at(x[m], "x"), at(high[m], "y"));
        for (let m = end - 1; m >= k; m--) c.lineTo(at(x[m], "x"), at(low[m], "y"));
        c.fill();
      }
    }
    c.restore();
  }

  function axes(unit, log) {
    const one = { stroke: colour("soft"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, font: "11px system-ui, sans-serif" };
    return [Object.assign({ size: 30, values: (u, vs) => vs.map(clock) }, one),
      Object.assign({ size: 62, label: unit, labelSize: 16, labelFont: "11px system-ui, sans-serif", values: (u, vs) => ticks(vs) }, one)];
  }

  /* All of a run within its limits; of a part what is there fills the height, but for dots, which have their gates. */
  function room(chart) {
    const dots = chart.lines.some(line => line.kind === "dots");
    return (u, low, high) => {
      if (chart.limits && (dots || shown[1] - shown[0] >= whole[1] - whole[0])) return chart.limits;
      if (low == null) return [0, 1];
      const r = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
      return [low - r, high + r];
    };
  }

  /* Dots; what lies outside the limits is shown at the border, so that nothing is hidden. */
  function beyond(u, chart) {
    if (!chart.limits || !chart.lines.some(line => line.kind === "dots")) return;
    const c = u.ctx, b = u.bbox, s = 4 * devicePixelRatio, values = column(chart.lines.find(line => line.kind === "dots").column);
    const dot = 2 * devicePixelRatio, low = u.scales.x.min, high = u.scales.x.max;
    const left = b.left, across = b.width / (high - low), down = b.height / (chart.limits[1] - chart.limits[0]);
    const begin = since(low), end = since(high + 1e-12 * (whole[1] - whole[0]));
    /* No pixel is filled twice: many dots lie upon one another. */
    const wide = Math.ceil(b.width) + 1, taken = new Uint8Array(wide * (Math.ceil(b.height) + 1)), above = new Set(), below = new Set();
    c.fillStyle = colour("dots");
    for (let k = begin; k < end; k++) {
      const v = values[k];
      if (!Number.isFinite(v)) continue;
      const x = (time[k] - low) * across, y = (chart.limits[1] - v) * down;
      if (y < 0 || y > b.height) {  // marks that share a pixel are one
        (y < 0 ? above : below).add(Math.round(x));
        continue;
      }
      const place = Math.round(y) * wide + Math.round(x);
      if (taken[place]) continue;
      taken[place] = 1;
      c.fillRect(left + x - dot / 2, b.top + y - dot / 2, dot, dot);
    }
    c.fillStyle = colour("gate");
    for (const [border, y, d] of [[above, b.top, 1], [below, b.top + b.height, -1]]) for (const x of border) {
      c.beginPath(); c.moveTo(left + x, y); c.lineTo(left + x - s, y + d * 1.6 * s); c.lineTo(left + x + s, y + d * 1.6 * s); c.fill();
    }
  }

  function build(box, chart) {
    forget(box);
    const { columns, series, around } = drawn(chart);
    const log = chart.log;
    const u = new uPlot({
      width: box.clientWidth, height: chart.height || 200, series, axes: axes(chart.unit, log),
      scales: { x: { time: false }, y: log ? { distr: 3 } : { range: room(chart) } },
      legend: { live: true }, hooks: {
        drawAxes: [v => envelopes(v, around)],
        draw: [v => beyond(v, chart)],
        setScale: [(v, key) => { if (key === "x" && v.status === 1) chosen(v.scales.x.min, v.scales.x.max); }],
      },
      cursor: { sync: { key: "run", filters: { pub: kind => kind === "mousemove" || kind === "mouseleave" } }, drag: { x: true, y: false } },
    }, [[], ...columns.map(() => [])], box);
    charts.set(box, u);
    whole_of.set(u, columns);
    follow(u);
    u.over.addEventListener("dblclick", () => show(whole[0], whole[1]));
  }

  function forget(box) {
    const old = charts.get(box);
    if (!old) return;
    old.destroy(); whole_of.delete(old);
  }

  function timeline(box, chart) {
    forget(box);
    const rows = chart.rows, n = rows.length;
    const u = new uPlot({
      width: box.clientWidth, height: 34 + 26 * n, legend: { show: false },
      series: [{}, { stroke: "transparent", points: { show: false } }],
      scales: { x: { time: false }, y: { range: [0, n] } },
      axes: [axes("", false)[0], { stroke: colour("soft"), size: 185, font: "11px system-ui, sans-serif", grid: { show: false }, ticks: { show: false },
        splits: () => rows.map((r, i) => n - i - 0.5), values: () => rows.map(r => r.label) }],
      cursor: { sync: { key: "run", filters: { pub: kind => kind === "mousemove" || kind === "mouseleave" } }, drag: { x: true, y: false } },
      hooks: {
        setScale: [(v, key) => { if (key === "x" && v.status === 1) chosen(v.scales.x.min, v.scales.x.max); }],
        draw: [v => {
          const c = v.ctx, least = devicePixelRatio * 1.5;
          c.save(); c.beginPath(); c.rect(v.bbox.left, v.bbox.top, v.bbox.width, v.bbox.height); c.clip();
          rows.forEach((row, i) => {
            c.fillStyle = colour(row.colour);
            const top = v.valToPos(n - i - 0.14, "y", true), bottom = v.valToPos(n - i - 0.86, "y", true), on = column(row.column);
            /* From the mark before the window on; marks that share a pixel are one. */
            const end = since(v.scales.x.max + 1e-12 * (whole[1] - whole[0]));
            let k = Math.max(0, since(v.scales.x.min) - 1), from = NaN, to = NaN;
            while (k > 0 && on[k] > 0) k--;
            for (; k < end; k++) {
              if (!(on[k] > 0)) continue;
              let e = k;
              while (e + 1 < time.length && on[e + 1] > 0) e++;
              const a = v.valToPos(time[k], "x", true), b = v.valToPos(time[Math.min(e + 1, time.length - 1)], "x", true);
              if (!(a <= to)) { if (to > from) c.fillRect(from, top, to - from, bottom - top); from = a; }
              to = Math.max(a + least, b);
              k = e;
            }
            if (to > from) c.fillRect(from, top, to - from, bottom - top);
          });
          c.restore();
        }],
      },
    }, [whole, [null, null]], box);
    charts.set(box, u);
    follow(u);
    u.over.addEventListener("dblclick", () => show(whole[0], whole[1]));
  }

  const waiting = new Map();
  const make = (box, chart) => (chart.rows ? timeline : build)(box, chart);
  const watcher = new IntersectionObserver(entries => entries.forEach(entry => {
    if (entry.isIntersecting) seen.add(entry.target); else seen.delete(entry.target);
    if (entry.isIntersecting && stale.delete(entry.target) && charts.has(entry.target)) follow(charts.get(entry.target));
    if (entry.isIntersecting && waiting.has(entry.target)) { make(entry.target, waiting.get(entry.target)); waiting.delete(entry.target); }
  }), { rootMargin: "200px" });
  /* With the keyboard: where the cursor would be, in steps of a hundredth. */
  function values(box, event) {
    const u = charts.get(box), way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!u || !way || event.ctrlKey || event.metaKey || event.altKey) return;
    const width = u.over.clientWidth, before = u.cursor.left >= 0 ? u.cursor.left : way > 0 ? 0 : width;
    const left = Math.max(0, Math.min(width - 1, before + way * width / 100));
    u.setCursor({ left, top: u.over.clientHeight / 2 });
    event.preventDefault();
  }
  const all = [];
  for (const chart of run.charts) {
    const card = document.createElement("div"), head = document.createElement("h3"), box = document.createElement("div");
    card.className = "chart" + (chart.wide ? " wide" : ""); box.className = "plot";
    box.tabIndex = 0; box.setAttribute("role", "group");
    box.setAttribute("aria-label", chart.title + ": left and right show values, plus and minus zoom, 0 shows everything");
    box.addEventListener("keydown", event => values(box, event));
    head.textContent = chart.title; card.append(head, box);
    document.getElementById(chart.section).append(card);
    all.push([box, chart]); waiting.set(box, chart); watcher.observe(box);
  }
  const finish = () => { stale.forEach(box => follow(charts.get(box))); stale.clear(); waiting.forEach((chart, box) => make(box, chart)); waiting.clear(); };
  /* What is out of sight is drawn when nothing else is to do: who takes a picture of the whole page has every chart in it. */
  const idle = window.requestIdleCallback || (work => setTimeout(work, 50));
  const rest = () => { const [next] = waiting; if (next) { waiting.delete(next[0]); make(...next); idle(rest); } };
  addEventListener("load", () => idle(rest));
  const again = () => { for (const [box, chart] of all) if (charts.has(box)) make(box, chart); space(); };
  new ResizeObserver(() => {
    charts.forEach((u, box) => {
      if (Math.abs(u.width - box.clientWidth) > 1) { u.setSize({ width: box.clientWidth, height: u.height }); follow(u); }
    });
    space();
  }).observe(document.body);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  /* Printed are all charts, and in the colours of paper. */
  const paper = printed => { document.documentElement.classList.toggle("printing", printed); finish(); again(); };
  addEventListener("beforeprint", () => paper(true));
  addEventListener("afterprint", () => paper(false));

  const on = (id, action) => document.getElementById(id).addEventListener("click", action);
  on("in", () => zoom(0.5)); on("out", () => zoom(2)); on("left", () => move(-0.25)); on("right", () => move(0.25));
  on("all", () => show(whole[0], whole[1]));
  addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.id === "space") return;
    const action = { "+": () => zoom(0.5), "-": () => zoom(2), "0": () => show(whole[0], whole[1]), ",": () => move(-0.25), ".": () => move(0.25) }[event.key];
    if (action) { action(); event.preventDefault(); }
  });

  /* The approach in space: x out of the port to the right, seen by an eye that turns about it. */
  let turn = -0.62, tilt = 0.42, closer = 1, magnified = 1;
  const nice = v => { const p = 10 ** Math.floor(Math.log10(v)); return (v / p >= 5 ? 5 : v / p >= 2 ? 2 : 1) * p; };
  const sizeOf = a => Math.hypot(a[0], a[1], a[2]);

  /* How many times their size ellipsoids are drawn: a power of ten, so that the usual one in sight can be seen. */
  function magnification(path, far) {
    const near = path.ellipsoids.filter(e => sizeOf(e.at) <= far), some = near.length ? near : path.ellipsoids;
    const sizes = some.map(e => Math.max(...e.axes.map(sizeOf))).sort((a, b) => a - b), usual = sizes[sizes.length >> 1];
    return usual > 0 ? 10 ** Math.max(0, Math.floor(Math.log10(0.06 * far / usual))) : 1;
  }

  function space() {
    const canvas = document.getElementById("space"), path = run.path;
    if (!canvas || !path) return;
    const scale = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    canvas.width = w * scale; canvas.height = h * scale;
    const c = canvas.getContext("2d");
    c.scale(scale, scale);
    const far = path.far / closer, size = Math.min(w / (far * 1.12), h / (far * 0.58));
    const ct = Math.cos(turn), st = Math.sin(turn), cp = Math.cos(tilt), sp = Math.sin(tilt);
    const at = (x, y, z) => { const u = x - far / 2, a = u * ct + y * st, b = -u * st + y * ct; return [w / 2 + a * size, h / 2 + (z * cp + b * sp) * size]; };
    const line = (points, style, width, dash) => {
      c.beginPath(); c.strokeStyle = style; c.lineWidth = width; c.setLineDash(dash || []);
      points.forEach((p, i) => (p == null ? 0 : i && points[i - 1] ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1]))); c.stroke(); c.setLineDash([]);
    };
    const ring = (x, r) => Array.from({ length: 49 }, (_, k) => at(x, r * Math.cos(k * Math.PI / 24), r * Math.sin(k * Math.PI / 24)));
    const wide = Math.tan(run.corridor * Math.PI / 180);
    c.globalAlpha = 0.8;
    for (let k = 1; k <= 4; k++) line(ring(far * k / 4, wide * far * k / 4), colour("spread"), 0.7);
    for (let k = 0; k < 8; k++) { const a = k * Math.PI / 4; line([at(0, 0, 0), at(far, wide * far * Math.cos(a), wide * far * Math.sin(a))], colour("spread"), 0.7); }
    c.globalAlpha = 1;
    line([at(0, 0, 0), at(far, 0, 0)], colour("soft"), 0.8, [4, 4]);
    const r = path.capture || (path.distance ? wide * path.distance : 0);
    if (path.capture > 0) line(ring(0, r), colour("published"), 1.8);
    if (path.distance > 0) {
      line(ring(path.distance, r), colour("published"), 1.8);
      if (path.capture > 0) for (let k = 0; k < 8; k++) {
        const a = k * Math.PI / 4, y = r * Math.cos(a), z = r * Math.sin(a);
        line([at(0, y, z), at(path.distance, y, z)], colour("published"), 0.9);
      }
    }
    magnified = magnification(path, far);
    c.globalAlpha = 0.85;
    let before = null;
    for (const e of path.ellipsoids) {
      const final = e === path.ellipsoids[path.ellipsoids.length - 1];
      if (before && !final && sizeOf(e.at.map((v, k) => v - before[k])) < 0.04 * far) continue;
      before = e.at;
      const most = magnified * Math.max(...e.axes.map(sizeOf)), times = magnified * Math.min(1, 0.16 * far / most);
      for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) line(Array.from({ length: 49 }, (_, k) => {
        const p = times * Math.cos(k * Math.PI / 24), q = times * Math.sin(k * Math.PI / 24), a = e.axes[i], b = e.axes[j];
        return at(e.at[0] + p * a[0] + q * b[0], e.at[1] + p * a[1] + q * b[1], e.at[2] + p * a[2] + q * b[2]);
      }), colour("gate"), 0.9, times < magnified ? [3, 4] : []);
    }
    c.globalAlpha = 1;
    line(path.x.map((x, i) => (x == null ? null : at(x, path.y[i], path.z[i]))), colour("estimate"), 2.2);
    c.fillStyle = colour("ink"); c.font = "12px system-ui, sans-serif";
    const named = (text, x, y) => { c.strokeStyle = colour("paper"); c.lineWidth = 3; c.strokeText(text, x, y); c.fillText(text, x, y); };
    const o = at(0, 0, 0); c.fillRect(o[0] - 4, o[1] - 4, 8, 8); named("port", o[0] - 12, o[1] + 20);
    const last = path.ellipsoids[path.ellipsoids.length - 1].at, end = at(last[0], last[1], last[2]);
    const tick = nice(far / (w < 560 ? 2.5 : 3.5));
    for (let k = 1; k * tick < far; k++) {
      const p = at(k * tick, 0, 0), text = short(k * tick) + " m", left = p[0] - 12, right = left + c.measureText(text).width;
      c.fillRect(p[0] - 1, p[1] - 3, 2, 6);
      const met = end[0] > left - 8 && end[0] < right + 8 && end[1] > p[1] - 8 && end[1] < p[1] + 24;  // by the dot of the end
      named(text, left, p[1] + (met ? -10 : 16));
    }
    c.beginPath(); c.fillStyle = colour("estimate"); c.arc(end[0], end[1], 4.5, 0, 7); c.fill();
    const length = far * 0.09, from = at(far * 0.5, 0, 0);
    [["x", [length, 0, 0]], ["y", [0, length, 0]], ["z", [0, 0, length]]].forEach(([name, d]) => {
      const p = at(far / 2 + d[0], d[1], d[2]), x = 60 + p[0] - from[0], y = h - 74 + p[1] - from[1];
      line([[60, h - 74], [x, y]], colour("soft"), 1.2); c.fillStyle = colour("soft"); c.fillText(name, x + 3, y + 3);
    });
    document.getElementById("drawn").textContent = "ellipsoids " + (magnified > 1 ? "drawn " + magnified.toLocaleString("en") + " times their size" : "to scale") + "; " + (+far.toPrecision(3)) + " m from the port in sight";
  }
  const canvas = document.getElementById("space");
  if (canvas && run.path) {
    let held = null;
    const come = factor => { closer = factor ? Math.min(1e4, Math.max(1, closer * factor)) : 1; space(); };
    canvas.addEventListener("pointerdown", e => { held = [e.clientX, e.clientY, turn, tilt]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", e => {
      if (!held) return;
      turn = held[2] - (e.clientX - held[0]) / 160; tilt = Math.max(-1.5, Math.min(1.5, held[3] + (e.clientY - held[1]) / 160)); space();
    });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointercancel", () => { held = null; });
    canvas.addEventListener("keydown", e => {
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      const factor = { "+": 2, "-": 0.5, "0": 0 }[e.key];
      const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (factor != null) come(factor);
      else if (step) { turn += step[0]; tilt = Math.max(-1.5, Math.min(1.5, tilt + step[1])); space(); }
      else return;
      e.preventDefault();
    });
    on("near", () => come(2)); on("far", () => come(0.5)); on("path", () => come(0));
    space();
  }
  show(whole[0], whole[1]);
  window.relnavPage = { show, finish, shown: () => shown.slice(), built: () => charts.size, all: all.length,
    upright: k => { const y = charts.get(all[k][0]).scales.y; return [y.min, y.max]; } };
})();
