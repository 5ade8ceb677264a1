// Panels over time: drag to zoom all panels of a clock, double-click (or -tap) to see all again.
// Without this script, and on paper, the pictures stand in their place.
(() => {
"use strict";
const HEIGHT = 150, SAMPLE = 24, BAND = "#eef1f5", NONE = 65535;
const clocks = {};  // group and label of a time -> its plots, bars, zoom

async function inflate(text) {
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function readValues(column, bytes) {
  const out = new Array(column.n);
  for (let i = 0, q = 0; i < column.n; i++) {
    q = (q + bytes[column.at + i] + 256 * bytes[column.at + column.n + i]) & NONE;
    out[i] = q === NONE ? null : column.low + q * column.step;
  }
  return out;
}

function joinLines(panel, bytes) {
  const tables = panel.lines.map(line => [readValues(line.t, bytes), readValues(line.y, bytes)]);
  const same = t => t.n === panel.lines[0].t.n && t.low === panel.lines[0].t.low && t.step === panel.lines[0].t.step;
  return panel.lines.every(line => same(line.t)) ? [tables[0][0], ...tables.map(t => t[1])] : uPlot.join(tables);
}

function write(x) {
  if (x == null) return "–";
  const size = Math.abs(x);
  return x === 0 ? "0" : size >= 1e4 || size < 1e-3 ? x.toExponential(2) : x.toPrecision(4);
}

function findPhase(phases, t) {
  const phase = phases.find(p => t >= p[1] && t < p[2]);
  return phase ? `, phase ${phase[3]} ${phase[0]}` : "";
}

function drawBack(u, panel, phases) {
  const {ctx, bbox: b} = u;
  const x = t => u.valToPos(t, "x", true), y = v => u.valToPos(v, "y", true);
  ctx.save();
  ctx.beginPath();
  ctx.rect(b.left, b.top, b.width, b.height);
  ctx.clip();
  phases.forEach((p, i) => {
    if (i % 2) return;
    ctx.fillStyle = BAND;
    ctx.fillRect(x(p[1]), b.top, x(p[2]) - x(p[1]), b.height);
  });
  for (const area of panel.areas) {
    const [x0, x1] = area.x ? area.x.map(x) : [b.left, b.left + b.width];
    const [y0, y1] = area.y ? area.y.map(y) : [b.top, b.top + b.height];
    ctx.fillStyle = area.color;
    ctx.fillRect(x0, Math.min(y0, y1), x1 - x0, Math.abs(y1 - y0));
  }
  ctx.restore();
}

function meetsData(u, [left, base, wide]) {  // whether a line of data passes through a text
  const {bbox: b} = u, dpr = devicePixelRatio, top = base - 11 * dpr, low = base + 3 * dpr;
  const [t, ...columns] = u.data;
  const from = Math.max(u.posToIdx((left - b.left) / dpr) - 1, 0);
  const to = Math.min(u.posToIdx((left + wide - b.left) / dpr) + 1, t.length - 1);
  return columns.some(values => {
    let last = null;  // the previous point; lines are straight between points
    for (let i = from; i <= to; i++) {
      if (values[i] === undefined) continue;  // a point of another line
      const at = values[i] === null ? null : [u.valToPos(t[i], "x", true), u.valToPos(values[i], "y", true)];
      const [p, q] = [last || at, at];
      last = at;
      if (!at || p[0] > left + wide || q[0] < left) continue;
      if (Math.min(p[1], q[1]) < low && Math.max(p[1], q[1]) > top) return true;
    }
    return false;
  });
}

function drawFront(u, panel, phases, first) {
  const {ctx, bbox: b} = u, dpr = devicePixelRatio;
  const x = t => u.valToPos(t, "x", true), right = b.left + b.width;
  ctx.save();
  ctx.font = `${11 * dpr}px sans-serif`;
  ctx.textBaseline = "alphabetic";
  if (first) {
    ctx.fillStyle = "#444";
    ctx.textAlign = "center";
    let end = b.left;
    for (const [name, from, to, number] of phases) {
      const left = Math.max(x(from), b.left), stop = Math.min(x(to), right), middle = 0.5 * (left + stop);
      const fits = [`${number} ${name}`, `${number}`].find(s => ctx.measureText(s).width < stop - left + 4 * dpr);
      if (!fits || stop <= left || middle - 0.5 * ctx.measureText(fits).width < end) continue;
      ctx.fillText(fits, middle, b.top - 5 * dpr);
      end = middle + 0.5 * ctx.measureText(fits).width + 2 * dpr;
    }
  }
  for (const mark of panel.marks.filter(mark => x(mark.x) >= b.left && x(mark.x) <= right)) {
    ctx.strokeStyle = mark.color;
    ctx.lineWidth = mark.width * dpr;
    ctx.setLineDash(mark.dash.map(d => d * dpr));
    ctx.beginPath();
    ctx.moveTo(x(mark.x), b.top);
    ctx.lineTo(x(mark.x), b.top + b.height);
    ctx.stroke();
  }
  const names = [];  // [left, base line, width] of each
  const lines = panel.levels.map(level => u.valToPos(level.y, "y", true));
  ctx.textAlign = "left";
  for (const [i, level] of panel.levels.entries()) {
    const y = lines[i];
    if (y < b.top - 1 || y > b.top + b.height + 1) continue;
    const spans = level.spans.length ? level.spans.map(s => s.map(x)) : [[b.left, right]];
    const shown = spans.map(([p, q]) => [Math.max(p, b.left), Math.min(q, right)]).filter(([p, q]) => q > p);
    ctx.strokeStyle = ctx.fillStyle = level.color;
    ctx.lineWidth = level.width * dpr;
    ctx.setLineDash(level.dash.map(d => d * dpr));
    for (const [p, q] of shown) {
      ctx.beginPath();
      ctx.moveTo(p, y);
      ctx.lineTo(q, y);
      ctx.stroke();
    }
    if (!shown.length || !level.label) continue;
    const wide = Math.min(ctx.measureText(level.label).width + 8 * dpr, b.width);
    const ends = [shown[shown.length - 1][1] - wide, shown[0][0]].map(at => Math.max(Math.min(at, right - wide), b.left));
    const bases = [y - 4 * dpr, y + 13 * dpr].filter(base => base > b.top + 12 * dpr && base < b.top + b.height);
    const places = bases.flatMap(base => ends.map(at => [at, base, wide]));
    const free = ([at, base]) => !names.some(([other, line, width]) =>
      Math.abs(line - base) < 13 * dpr && at < other + width && other < at + wide);
    const clear = ([, base]) => !lines.some(line => line > base - 10 * dpr && line < base + 2 * dpr);
    const empty = p => free(p) && clear(p) && !meetsData(u, p);
    // data hide a name at its line: it stands elsewhere, after a sample of the line
    const long = Math.min(wide + SAMPLE * dpr, b.width), rows = [b.top + 13 * dpr, b.top + b.height - 5 * dpr];
    const entries = rows.flatMap(base => [right - long, b.left].map(at => [at, base, long]));
    const near = places.find(empty), entry = near || !places.length ? null : entries.find(empty);
    const place = near || entry || places.find(p => free(p) && clear(p)) || places.find(free) || places[0];
    if (!place) continue;  // a plot without room for text
    names.push(place);
    if (entry) {
      ctx.beginPath();
      ctx.moveTo(place[0] + 4 * dpr, place[1] - 4 * dpr);
      ctx.lineTo(place[0] + (SAMPLE - 2) * dpr, place[1] - 4 * dpr);
      ctx.stroke();
    }
    ctx.setLineDash([]);  // a white outline, so that lines below the name leave it readable
    ctx.lineWidth = 3 * dpr;
    ctx.strokeStyle = "#fff";
    const text = [level.label, place[0] + (entry ? SAMPLE : 0) * dpr + 4 * dpr, place[1], wide - 8 * dpr];
    ctx.strokeText(...text);
    ctx.fillText(...text);
  }
  ctx.restore();
}

function zoom(clock, range) {  // [from, to], or null: each panel shows all of its own
  clock.range = range;
  for (const {u, panel} of clock.plots) {
    const [min, max] = range || panel.x;
    u.setScale("x", {min, max});
  }
  for (const bar of clock.bars) bar.reset.hidden = !range;
}

function follow(clock, t) {
  for (const bar of clock.bars) if (bar.replay) {
    bar.replay.href = `replay.html#t=${t.toFixed(1)}`;
    bar.replay.textContent = `Replay at ${t.toFixed(1)} s`;
  }
}

function addTouch(u, clock) {  // uPlot knows mice; a finger selects across and scrolls along
  const over = u.over, at = e => e.clientX - over.getBoundingClientRect().left;
  let start = null, tapped = -1e9;
  const select = (left, width) => u.setSelect({left, width, top: 0, height: over.clientHeight}, false);
  over.addEventListener("pointerdown", e => {
    if (e.pointerType !== "touch") return;
    if (e.timeStamp - tapped < 300) zoom(clock, null);
    tapped = e.timeStamp;
    start = at(e);
    u.setCursor({left: start, top: over.clientHeight / 2});
  });
  over.addEventListener("pointermove", e => {
    if (start === null || e.pointerType !== "touch") return;
    u.setCursor({left: at(e), top: over.clientHeight / 2});
    select(Math.min(start, at(e)), Math.abs(at(e) - start));
  });
  const finish = e => {
    if (start === null || e.pointerType !== "touch") return;
    const ends = [start, at(e)].sort((a, b) => a - b);
    if (e.type === "pointerup" && ends[1] - ends[0] > 10) zoom(clock, ends.map(p => u.posToVal(p, "x")));
    select(0, 0);
    start = null;
  };
  over.addEventListener("pointerup", finish);
  over.addEventListener("pointercancel", finish);
}

function keepDecades(u, splits) {  // of a logarithmic axis
  return splits.map(v => Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v : null);
}

function addPanel(box, panel, data, phases, clock, group, first) {
  const title = document.createElement("h4"), chart = document.createElement("div");
  title.textContent = panel.title;
  box.append(title, chart);
  const value = unit => (u, v) => v == null ? "–" : `${write(v)} ${unit}`;
  const named = panel.lines.filter(line => line.label).length;
  const u = new uPlot({
    width: Math.max(chart.clientWidth, 200), height: HEIGHT + (first ? 16 : 0),
    padding: [first ? 22 : 8, 24, 0, 0],  // at the right: half of a number below the last tick
    scales: {
      x: {time: false, auto: false, range: (u, min, max) => [min, max]},
      y: {distr: panel.log ? 3 : 1, range: (u, min, max) => {
        if (!clock.range || min == null) return panel.y;
        if (panel.log) return [min / 1.2, max * 1.2];
        // of a range near the resolution of the numbers uPlot would compute ticks without end
        const room = Math.max(0.1 * (max - min), 1e-4 * Math.abs(max)) || 1;
        return [min - room, max + room];
      }},
    },
    axes: [{size: 26, values: (u, ticks) => ticks.map(t => String(+t.toFixed(6)))},
           {size: 56, label: panel.label, labelSize: 16, labelFont: "11px sans-serif", font: "11px sans-serif",
            ...(panel.log ? {grid: {filter: keepDecades}, ticks: {filter: keepDecades}} : {})}],
    cursor: {
      sync: {key: `${group} ${panel.clock}`, setSeries: false, filters: {pub: type => type === "mousemove" || type === "mouseleave"}},
      drag: {x: true, y: false, setScale: false},
      points: {size: 5},
      bind: {dblclick: () => () => { zoom(clock, null); return null; }},
    },
    series: [
      {label: "time", value: (u, t) => t == null ? "–" : `${t.toFixed(2)} s${findPhase(phases, t)}`},
      ...panel.lines.map((line, i) => ({
        label: line.label || (named ? `line ${i + 1}` : "value"), stroke: line.color, width: line.width,
        dash: line.dash, value: value(panel.unit), spanGaps: false,
        ...(line.points ? {paths: () => null, points: {show: true, size: 4, fill: line.color}} : {points: {show: false}}),
      })),
    ],
    hooks: {
      drawClear: [u => drawBack(u, panel, phases)],
      draw: [u => drawFront(u, panel, phases, first)],
      setSelect: [u => {
        if (u.select.width > 3) {
          zoom(clock, [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")]);
        }
        u.setSelect({left: 0, width: 0, top: 0, height: 0}, false);
      }],
      setCursor: [u => { if (u.cursor.event && u.cursor.idx != null) follow(clock, u.data[0][u.cursor.idx]); }],
    },
  }, data, chart);
  u.setScale("x", {min: panel.x[0], max: panel.x[1]});
  clock.plots.push({u, panel});
  addTouch(u, clock);
  new ResizeObserver(() => {
    const width = chart.clientWidth;
    if (width && width !== u.width) u.setSize({width, height: u.height});
  }).observe(chart);
}

async function addFigure(script) {
  const found = JSON.parse(script.textContent), figure = script.closest("figure");
  const bytes = await inflate(found.data);
  const box = document.createElement("div"), bar = document.createElement("div");
  box.className = "panels";
  bar.className = "bar";
  bar.append("Drag to zoom in time, double-click to see all.");
  box.append(bar);
  script.before(box);
  figure.classList.add("live");
  const shown = found.panels.filter(panel => panel.lines.length);
  shown.forEach((panel, i) => {
    const clock = clocks[`${found.group} ${panel.clock}`] ||= {plots: [], bars: [], range: null};
    if (!i) {
      const reset = document.createElement("button"), entry = {reset, replay: null};
      reset.textContent = "Show all";
      reset.hidden = true;
      reset.addEventListener("click", () => zoom(clock, null));
      bar.append(reset);
      if (document.querySelector('a[href="replay.html"]') && panel.clock === "time since the start of the run (s)") {
        entry.replay = document.createElement("a");
        entry.replay.href = entry.replay.textContent = "";
        bar.append(entry.replay);
      }
      clock.bars.push(entry);
    }
    addPanel(box, panel, joinLines(panel, bytes), found.phases, clock, found.group, !i);
  });
  const unit = document.createElement("p");
  unit.className = "soft";
  const names = found.phases.map(p => `${p[3]} ${p[0]}`.replaceAll(" ", "\u00a0"));
  unit.textContent = shown[0].clock + (names.length ? `. Phases: ${names.join(" · ")}` : "");
  box.append(unit);
}

(async () => {
  for (const script of document.querySelectorAll('figure > script[type="application/json"]')) {
    try {
      await addFigure(script);
    } catch (error) {  // an old browser: the picture stays
      script.closest("figure").classList.remove("live");
      console.warn(error);
    }
  }
  window.skywrightPlots = clocks;
  document.documentElement.dataset.plots = "ready";
})();
})();
