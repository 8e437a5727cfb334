'use strict';
// Draws what the program tells and passes on what the person wishes; computes nothing.
const $ = id => document.getElementById(id);
const say = (id, text) => { const e = $(id); if (e.textContent !== text) e.textContent = text; };
const number = (x, digits) => {
  if (x === null || x === undefined) return '–';
  const text = x.toFixed(digits);
  // No sign of a zero.
  return Number(text) === 0 ? text.replace('-', '') : text.replace('-', '\u2212');
};
const minus = text => text.replace(/(^|\s)-(?=\d)/g, '$1\u2212');
const signed = (x, digits) => (x > 0 ? '+' : '') + number(x, digits);
let view = null, drawn = {};

async function wish(body) {
  const answer = await fetch('wish' + location.search, {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) }).catch(() => null);
  if (!answer || !answer.ok) say('message', 'that did not reach the program');
}

const KEYS = { m: 'measure', r: 'redo', s: 'skip', p: 'pause', w: 'swap-series', b: 'best', q: 'stop' };
for (const id of Object.values(KEYS)) {
  $(id).addEventListener('click', () => {
    if (id === 'stop' && !confirm('Finish the test? What was measured is kept.')) return;
    wish({ wish: id });
  });
}
document.addEventListener('keydown', event => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === 'INPUT') return;
  if (event.key === 'c') { $('remark').focus(); event.preventDefault(); return; }
  const id = KEYS[event.key];
  if (id && !$(id).disabled && view && !view.watching) { $(id).click(); event.preventDefault(); }
});
$('remark-form').addEventListener('submit', event => {
  event.preventDefault();
  if ($('remark').value.trim()) wish({ wish: 'remark', text: $('remark').value });
  $('remark').value = '';
  $('measure').focus();
});
$('temperature-form').addEventListener('submit', event => {
  event.preventDefault();
  const temp_c = Number($('temperature').value.replace(',', '.'));
  if ($('temperature').value.trim() && Number.isFinite(temp_c)) wish({ wish: 'temperature', temp_c });
  else say('message', 'that is no temperature');
  $('temperature').value = '';
});

const sense = approach => approach === 'cw' ? 'from above, clockwise' : 'from below, counter-clockwise';
const place = stop => `Series ${stop.series} · dial ${number(stop.dial_deg, stop.dial_deg % 1 ? 2 : 0)}°`;

function now(v) {
  const stop = v.at === null ? null : v.stops[v.at];
  const is = v.phase.is;
  say('count', stop ? `Position ${v.at + 1} of ${v.stops.length}, ${v.readings.length} measured` : `${v.readings.length} of ${v.stops.length} positions measured`);
  say('what', v.watching ? 'A record' : is === 'lost' ? 'The instrument is lost' : is === 'over' ? 'The test is over' : stop ? place(stop) : 'All positions are measured');
  say('how', is === 'lost' ? 'Look at the cable: it goes on when the instrument is there again.'
    : is === 'over' ? `The campaign is in ${v.folder}. Next: vre identify ${v.folder}`
    : is === 'paused' ? 'Paused. Measure goes on.'
    : stop ? `${sense(stop.approach)}; mounted at ${number(stop.mount_deg, 0)}°, ${stop.along} along the shaft` : '');
  say('message', is === 'lost' ? v.phase.reason : v.message);
  const [part, whole, text] = is === 'settle' ? [v.steady_s, v.settle_s, 'settled'] : is === 'read' ? [v.read_s, v.dwell_s, 'read'] : [0, 1, ''];
  const share = Math.min(100, 100 * part / whole);
  $('bar').style.width = share + '%';
  $('progress').setAttribute('aria-valuenow', share.toFixed(0));
  say('progress-text', text ? `${text}: ${number(part, 1)} s of ${number(whole, 1)}` : is === 'place' && !v.watching ? 'Turn the dial, then measure.' : '');
  const waits = ['place', 'paused'].includes(is);
  $('measure').disabled = !(waits && stop);
  $('redo').disabled = is === 'over' || !v.readings.length;
  for (const id of ['skip', 'swap-series', 'best']) $(id).disabled = is === 'over' || !stop;
  $('pause').disabled = is === 'over' || is === 'paused' || is === 'lost';
  $('stop').disabled = is === 'over';
}

// 0 is on top and angles grow counter-clockwise, as the dial is seen by the person who turns it.
const at = (deg, r) => [-r * Math.sin(deg * Math.PI / 180), -r * Math.cos(deg * Math.PI / 180)].map(x => x.toFixed(2));
function dial(stop) {
  const key = JSON.stringify(stop);
  if (drawn.dial === key) return;
  drawn.dial = key;
  const parts = ['<circle class="rim" r="100"/>'];
  for (let deg = 0; deg < 360; deg += 15) {
    const [x1, y1] = at(deg, deg % 45 ? 94 : 90), [x2, y2] = at(deg, 100);
    parts.push(`<line class="tick" x1="${x1}" y1="${y1}" x2="${x2}" y2="${y2}"/>`);
    if (deg % 45 === 0) { const [x, y] = at(deg, 79); parts.push(`<text x="${x}" y="${y}">${deg}</text>`); }
  }
  let told = 'no position';
  if (stop) {
    const [x1, y1] = at(stop.dial_deg, 86), [x2, y2] = at(stop.dial_deg, 106);
    parts.push(`<line class="mark" x1="${x1}" y1="${y1}" x2="${x2}" y2="${y2}"/>`);
    const way = stop.approach === 'cw' ? 1 : -1;
    const [ax, ay] = at(stop.dial_deg + way * 38, 64), [bx, by] = at(stop.dial_deg + way * 8, 64);
    parts.push(`<path class="sense" d="M${ax} ${ay} A64 64 0 0 ${stop.approach === 'cw' ? 1 : 0} ${bx} ${by}"/>`);
    const [tx, ty] = at(stop.dial_deg + way, 64), [ux, uy] = at(stop.dial_deg + way * 9, 69), [wx, wy] = at(stop.dial_deg + way * 9, 59);
    parts.push(`<path class="tip" d="M${tx} ${ty}L${ux} ${uy}L${wx} ${wy}Z"/>`);
    // At 0 the axis that turns points down; an angle turns it counter-clockwise.
    const turn = -(stop.dial_deg + stop.mount_deg), axis = stop.along === 'IA' ? 'PA' : 'IA';
    parts.push(`<g transform="rotate(${turn})"><rect class="body" x="-20" y="-26" width="40" height="52" rx="4"/>`
      + `<line class="axis" x1="0" y1="0" x2="0" y2="38"/><path class="axis" d="M0 48L-6 36L6 36Z"/></g>`);
    parts.push(`<text class="name" x="${(-34 * Math.cos(turn * Math.PI / 180)).toFixed(1)}" y="${(-34 * Math.sin(turn * Math.PI / 180)).toFixed(1)}">${axis}</text>`);
    told = `dial at ${stop.dial_deg} degrees, ${sense(stop.approach)}, ${stop.along} along the shaft`;
  }
  $('dial').innerHTML = parts.join('');
  $('dial').setAttribute('aria-label', told);
}

function live(v) {
  say('output', v.output_g === null ? '–' : `${number(v.output_g, 6)} g`);
  say('expected', v.expected_g === null ? '–' : `${number(v.expected_g, 6)} ± ${number(2 * v.expected_sigma_g, 6)} g`);
  const known = v.output_g !== null && v.expected_g !== null;
  $('output').className = known && Math.abs(v.output_g - v.expected_g) <= 4 * v.expected_sigma_g + 1e-5 ? 'good' : '';
  say('noise', v.noise_g === null ? '–' : `${number(1e6 * v.noise_g, 1)} × 10⁻⁶ g`);
  say('temp', `${number(v.temp_c, 2)} °C`);
  const c = v.counts;
  say('lost', `${c.missing_samples} on the line, ${c.not_sent} at the converter`);
  say('converter', c.faults ? `${c.faults} faults, last: ${c.last_fault}` : c.restarts ? `${c.restarts} restarts` : 'sound');
  $('converter').className = c.faults ? 'bad' : '';
}

const color = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const charts = {};
// With a range that is not given the plot chooses its own.
function chart(id, series, bands, data, label, range) {
  const width = Math.max(200, $(id).clientWidth), key = width + color('--ground');
  const known = charts[id] || (charts[id] = {});
  known.range = range;
  if (known.key === key) { known.plot.setData(data); return; }
  if (known.plot) known.plot.destroy();
  const axis = { stroke: color('--dim'), grid: { stroke: color('--line'), width: .5 }, ticks: { stroke: color('--line') } };
  const y = { range: (_, low, high) => known.range || uPlot.rangeNum(low, high, .1, true) };
  known.key = key;
  known.plot = new uPlot({ width, height: 220, cursor: { show: false }, legend: { show: false }, scales: { x: { time: false }, y }, series, bands,
    axes: [{ ...axis, label: label[0], labelSize: 20, values: (_, ticks) => ticks.map(t => number(t, 0)) },
      { ...axis, label: label[1], labelSize: 20, size: 76, values: (_, ticks) => ticks.map(t => number(t, label[2](ticks))) }] }, data, $(id));
}
const places = ticks => ticks.length < 2 ? 3 : Math.max(0, Math.min(8, Math.ceil(-Math.log10(Math.abs(ticks[1] - ticks[0])) - 1e-9)));
function plots(v) {
  const times = v.trace.map(p => p[0]), last = times.length ? times[times.length - 1] : 0;
  const flat = value => times.map(() => value);
  const known = v.expected_g !== null, wide = 2 * v.expected_sigma_g;
  const around = known ? [v.expected_g - wide, v.expected_g + wide] : [null, null];
  // As near to what is expected as the last seconds are: the band is seen once the dial stands.
  const off = known ? v.trace.filter(p => last - p[0] < 3).map(p => Math.abs(p[1] - v.expected_g)) : [];
  const half = 1.3 * Math.max(1.5 * wide, ...off);
  const range = known ? [v.expected_g - half, v.expected_g + half] : null;
  const line = { stroke: color('--act'), width: 0, points: { show: false } };
  chart('trace', [{}, { stroke: color('--ink'), width: 1.5, points: { show: false } }, line, line], [{ series: [3, 2], fill: color('--band') }],
    [times.map(t => t - last), v.trace.map(p => p[1]), flat(around[0]), flat(around[1])], ['s before now', 'g', places], range);
  if (!v.vre || v.vre.history.length < 2) return;
  const h = v.vre.history;
  chart('history', [{}, { stroke: color('--act'), width: 2, points: { show: false } }, line, line], [{ series: [3, 2], fill: color('--band') }],
    [h.map(p => p[0]), h.map(p => 1e6 * p[1]), h.map(p => 1e6 * (p[1] - 2 * p[2])), h.map(p => 1e6 * (p[1] + 2 * p[2]))],
    ['readings', '10⁻⁶ g', places]);
}

const cell = (row, text, kind) => { const td = row.insertCell(); td.textContent = text; if (kind) td.className = kind; return td; };
function readings(v) {
  const key = JSON.stringify(v.readings.map(r => [r.reading, r.remark, r.sigma_g]));
  if (drawn.readings === key) return;
  drawn.readings = key;
  const last = v.readings[v.readings.length - 1];
  $('verdict').className = last ? !last.sound ? 'bad' : 'good' : '';
  say('verdict', last ? `${!last.sound ? '✗' : '✓'} Series ${last.series}, dial ${last.dial_deg}°: ${number(last.output_g, 7)} ± ${number(last.sigma_g, 7)} g; ${minus(last.reason)}` : 'none yet');
  const rows = $('reading-rows');
  rows.textContent = '';
  for (const r of [...v.readings].reverse()) {
    const row = rows.insertRow();
    cell(row, r.reading, 'number');
    cell(row, `${r.series} · ${r.dial_deg}°${r.mount_deg ? ` + ${r.mount_deg}°` : ''} ${r.approach}`);
    const fits = cell(row, r.sound ? '✓' : '✗ ', !r.sound ? 'bad' : 'good');
    fits.title = r.reason;
    if (!r.sound) fits.append(minus(r.reason));
    cell(row, number(r.output_g, 7), 'number');
    cell(row, `${signed(1e6 * r.residual_g, 1)} (${signed(r.sigmas, 1)})`, 'number');
    cell(row, r.remark);
  }
}

function results(v) {
  const key = JSON.stringify([v.coefficients, v.vre && v.vre.text, v.vre && v.vre.enough]);
  if (drawn.results === key) return;
  drawn.results = key;
  say('vre', v.vre ? `${minus(v.vre.text)} × 10⁻⁶ g in ${v.vre.environment} g along IA` : '–');
  const e = $('enough');
  if (v.vre && v.vre.enough !== null) {
    e.className = v.vre.enough ? 'good' : '';
    say('enough', `${v.vre.enough ? 'Enough: known' : 'Not yet known'} to ${number(100 * v.vre.share, 0)} %`);
  }
  const rows = $('coefficient-rows');
  rows.textContent = '';
  v.coefficients.forEach((c, k) => {
    const row = rows.insertRow(), name = document.createElement('th');
    name.scope = 'row';
    name.textContent = c.meaning;
    row.append(name);
    cell(row, c.text === 'undetermined' ? 'not yet' : k ? `${minus(c.text)} × 10⁻⁶` : `${minus(c.text)} V/g`, 'number');
  });
}

function stops(v) {
  const key = JSON.stringify([v.stops, v.at]);
  if (drawn.stops === key) return;
  drawn.stops = key;
  const list = $('stops');
  list.textContent = '';
  v.stops.forEach((stop, index) => {
    const item = document.createElement('li'), button = document.createElement('button');
    const taken = typeof stop.standing === 'object';
    const state = taken ? 'taken' : stop.standing;
    button.textContent = `${stop.series}·${stop.dial_deg}°${stop.mount_deg ? `+${stop.mount_deg}°` : ''}`;
    button.className = state;
    button.setAttribute('aria-label', `${place(stop)}, ${sense(stop.approach)}: ${taken ? 'measured, redo' : state === 'skipped' ? 'left out, go there' : 'waits, go there'}`);
    if (index === v.at) button.setAttribute('aria-current', 'step');
    button.disabled = v.watching || v.phase.is === 'over';
    button.addEventListener('click', () => wish(taken ? { wish: 'redo', reading: stop.standing.taken } : { wish: 'choose', stop: index }));
    item.append(button);
    list.append(item);
  });
}

function show(v) {
  view = v;
  say('serial', v.serial);
  document.title = `${v.watching ? 'Record' : 'Static test'} of ${v.serial}`;
  document.body.classList.toggle('watching', v.watching);
  now(v); dial(v.at === null ? null : v.stops[v.at]); live(v); plots(v); readings(v); results(v); stops(v);
  const lost = v.phase.is === 'lost';
  document.body.className = `${v.watching ? 'watching ' : ''}${lost ? 'off' : 'on'}`;
  say('link-text', lost ? 'instrument lost' : v.phase.is === 'over' ? 'over' : v.watching ? 'watching' : 'live');
}

const events = new EventSource('events' + location.search);
events.onmessage = event => { const v = JSON.parse(event.data); show(v); if (v.phase.is === 'over' && !v.watching) events.close(); };
events.onerror = () => {
  if (view && view.phase.is === 'over') return;
  document.body.classList.remove('on');
  document.body.classList.add('off');
  say('link-text', 'the program does not answer');
};
