// Plots over time with limits, and the current values as text beside them.
import uPlot from 'uplot';
import { format, make } from './dom.js';

const KEEP = 1500; // most points of a live plot
const INK = '#0b4f8a', LIMIT = '#b3005e';
const LEAST = 1e-4; // least range of a plot, relative to its values

// Returns the range of the axis of values. Of a range near the resolution of the numbers, such as
// that of a robot that stands still, uPlot would compute ticks without end. It is at least a few
// steps of the last of the `digits` shown, so that the ticks of a constant differ as they are written.
function findRange(digits, min, max) {
  if (min === null) return [0, 1]; // without values
  const least = Math.max(LEAST * Math.max(Math.abs(min), Math.abs(max)), 4 * 10 ** -digits);
  const more = 0.5 * Math.max(least - (max - min), 0);
  return uPlot.rangeNum(min - more, max + more, 0.1, true);
}

export class Plots {
  constructor(parent, channels, onseek) {
    this.channels = channels;
    this.t = [];
    this.values = channels.map(() => []);
    this.table = make('table', { class: 'numbers' });
    this.cells = channels.map((c) => {
      const value = make('td');
      const limit = c.limit === null ? '' : `limit ${format(c.limit, c.digits, c.unit)}`;
      const row = make('tr', {}, make('th', { scope: 'row', text: c.name }), value, make('td', { class: 'limit', text: limit }));
      this.table.append(row);
      return { row, value };
    });
    parent.append(this.table);
    this.box = make('div', { class: 'plots' });
    parent.append(this.box);
    this.plots = channels.map((c, i) => (c.plotted ? this.build(c, i, onseek) : null));
    this.cursor = null;
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.box);
  }

  // uPlot adds listeners to the window: without destroy its plots are never freed.
  destroy() {
    this.observer.disconnect();
    for (const p of this.plots) p?.destroy();
  }

  build(c, i, onseek) {
    const series = [{}, { stroke: INK, width: 1.5, points: { show: false } }];
    if (c.limit !== null) series.push({ stroke: LIMIT, width: 1.5, dash: [5, 4], points: { show: false } });
    const holder = make('div', { class: 'plot', role: 'img', 'aria-label': `${c.name} over time` });
    this.box.append(holder);
    const plot = new uPlot({
      width: 300, height: 100, title: `${c.name}${c.unit ? `, ${c.unit}` : ''}${c.limit !== null ? `  (dashed: limit ${c.limit})` : ''}`,
      legend: { show: false }, scales: { x: { time: false }, y: { range: (u, min, max) => findRange(c.digits, min, max) } }, padding: [8, 18, 0, 0], // at the right: half of the last time
      axes: [
        { size: 20, font: '10px sans-serif', values: (u, ticks) => ticks.map((x) => `${x} s`), ticks: { size: 3 }, gap: 1 },
        { size: 44, font: '10px sans-serif', ticks: { size: 3 }, gap: 2, space: 22 },
      ],
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      hooks: {
        draw: [(u) => {
          if (this.cursor === null) return;
          const x = u.valToPos(this.cursor, 'x', true);
          u.ctx.save();
          u.ctx.strokeStyle = '#444';
          u.ctx.beginPath();
          u.ctx.moveTo(x, u.bbox.top);
          u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
          u.ctx.stroke();
          u.ctx.restore();
        }],
      },
      series,
    }, [[], ...series.slice(1).map(() => [])], holder);
    if (onseek) plot.over.addEventListener('click', (e) => onseek(plot.posToVal(e.offsetX, 'x')));
    return plot;
  }

  resize() {
    const width = this.box.clientWidth;
    if (width > 40) for (const p of this.plots) p?.setSize({ width, height: 100 });
  }

  // Sets all values of a recording at once.
  fill(t, columns) {
    this.t = t;
    this.values = columns;
    this.draw();
  }

  // Adds one instant of a live flight.
  add(t, row, first) {
    if (this.t.length && t < this.t.at(-1)) this.clear();
    this.t.push(t);
    this.values.forEach((v, i) => v.push(Number.isFinite(row[first + i]) ? row[first + i] : null));
    if (this.t.length > KEEP) { this.t.shift(); this.values.forEach((v) => v.shift()); }
  }

  clear() {
    this.t = [];
    this.values = this.channels.map(() => []);
  }

  draw() {
    this.plots.forEach((p, i) => {
      if (!p) return;
      const limit = this.channels[i].limit;
      p.setData([this.t, this.values[i], ...(limit === null ? [] : [this.t.map(() => limit)])]);
    });
  }

  // Shows the current values.
  show(row, first) {
    this.channels.forEach((c, i) => {
      const value = row[first + i], { row: line, value: cell } = this.cells[i];
      cell.textContent = format(value, c.digits, c.unit);
      const over = c.limit !== null && Number.isFinite(value) && value > c.limit;
      line.classList.toggle('over', over);
      if (over) cell.textContent += ' ▲ beyond'; // colour alone does not suffice
    });
  }

  mark(t) {
    this.cursor = t;
    for (const p of this.plots) p?.redraw(false, false);
  }
}
