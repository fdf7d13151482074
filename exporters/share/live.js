"use strict";
// The page of `furrowmap live`: draws what the stream of events says, and sends nothing.
// Before it the server writes LANGUAGES: of each code the name and the texts by their English.
const WORDS = {
  worked: "worked", left: "left", rate: "rate", speed: "speed", fix: "GNSS", overlap: "overlap", missed: "missed", unseen: "not seen", dropped: "lost scans",
  sigma: "± 95 %", age: "age", togo: "to go",
  down: "TOOL DOWN", up: "TOOL UP", unknown: "TOOL ?", north: "N", day: "Day", night: "Night", sound: "♪ on", silent: "♪ off", hide: "Put away",
  fixed: "fixed", float: "float", single: "single", dgps: "DGPS", none: "none", ppp: "PPP", pps: "PPS", estimated: "estim.", manual: "manual", simulated: "simul.",
  starting: "Connecting …", cut: "No connection. What is shown is {age} s old.", stale: "What is shown is {age} s old.", waiting: "Waiting: {what}",
  over: "The recording has ended.", "over-waits": "The recording has ended. {seconds} s that were not shown are being worked out.",
  "lost-scans": "Scans are being dropped: the computer is too slow. Ground not seen is hatched.", "lost-positions": "No GNSS position for {seconds} s. Ground not seen is hatched.",
  "lost-tool": "State of the tool not seen. Ground not seen is hatched.", repair: "{seconds} s that were not shown are being worked out.",
  gap: "gap", ahead: "boundary {m} m", eye: "Line from A to B: guidance for the eye, not for steering.", a: "A", b: "B", clear: "A–B ×",
  "missing-positions": "no GNSS position: waiting for the receiver", "missing-heading": "heading unknown: drive some metres",
  "missing-direction": "forward is assumed: first metres", "missing-tilt": "tilt not seen: the vehicle is taken as level",
  "missing-implement": "no implement in the session: no ground worked", "missing-tool-learning": "tool not learned yet: lower and lift it some times",
  "missing-tool": "state of the tool not seen",
};
// Without a font of the language, as of Japanese, all its letters are the same box: then English is more use.
function drawn(letter) {
  const pen = Object.assign(document.createElement("canvas"), { width: 24, height: 24 }).getContext("2d");
  pen.font = getComputedStyle(document.body).font;
  pen.fillText(letter, 2, 20);
  return pen.canvas.toDataURL();
}
const asked = document.documentElement.dataset.language;
const known = (asked ? [asked] : navigator.languages).map((one) => one.split("-")[0]);
const language = known.find((one) => LANGUAGES[one] && drawn(LANGUAGES[one].name[0]) !== drawn(LANGUAGES[one].name[1])) ?? "en";
const words = Object.fromEntries(Object.entries(WORDS).map(([key, text]) => [key, LANGUAGES[language].texts[text] ?? text]));
document.documentElement.lang = language;
const $ = (id) => document.getElementById(id);
const FIGURES = ["worked", "left", "rate", "speed", "overlap", "missed", "unseen", "dropped", "fix", "sigma", "age", "togo"];
for (const name of FIGURES) $("l-" + name).textContent = words[name];
$("eye").textContent = words.eye;
$("hide").setAttribute("aria-label", words.hide);
$("tool").textContent = words.unknown;

// Cells: a canvas for each tile, drawn again only where cells changed.
const map = { origin: null, background: null, tool: null, field: [], headland: [], way: [], cell: 0.1, side: 64, tiles: new Map() };
let pose = null, spot = null, poseAt = 0, heardAt = 0, triedAt = 0, waiting = words.starting, connected = false;
let metres = 30, northUp = false, isOver = false, figures = null, droppedAt = -Infinity;
const dark = matchMedia("(prefers-color-scheme: dark)");
let night = (localStorage.getItem("furrowmap-night") ?? String(dark.matches)) === "true";

function colours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(["ground", "worked", "overlap", "missed", "not-seen", "boundary", "tool-down", "tool-up", "vehicle", "ink", "line", "paper"].map((n) => [n, style.getPropertyValue("--" + n).trim()]));
}
let colour = colours();
function rgba(hex) {
  const full = hex.length === 4 ? hex.replace(/[0-9a-f]/gi, "$&$&") : hex;
  return [1, 3, 5].map((i) => parseInt(full.slice(i, i + 2), 16));
}
function setNight() {
  document.documentElement.toggleAttribute("data-night", night);
  $("night").textContent = night ? words.day : words.night;
  colour = colours();
  for (const tile of map.tiles.values()) tile.stale = true;
}
$("night").onclick = () => { night = !night; localStorage.setItem("furrowmap-night", String(night)); setNight(); };
$("north").textContent = words.north;
$("north").onclick = () => { northUp = !northUp; $("north").setAttribute("aria-pressed", String(northUp)); };
$("near").onclick = () => { metres = Math.max(8, metres / 1.5); };
$("far").onclick = () => { metres = Math.min(2000, metres * 1.5); };

// The bearing line: two places where the button was tapped, kept by the browser.
let line = JSON.parse(localStorage.getItem("furrowmap-line") || "[]");
function setLine(places) {
  line = places;
  localStorage.setItem("furrowmap-line", JSON.stringify(line));
  $("bearing").textContent = [words.a, words.b, words.clear][line.length];
}
const LEAST_LINE_M = 5;
$("bearing").onclick = () => {
  if (line.length === 2) setLine([]);
  else if (pose && (!line.length || Math.hypot(pose.e_m - line[0][0], pose.n_m - line[0][1]) > LEAST_LINE_M)) setLine([...line, [pose.e_m, pose.n_m]]);
};

// A tone at each new alarm, and again while it lasts; browsers play none before the first tap.
let tones = null, tonedAt = 0;
$("sound").onclick = () => {
  tones = tones ? null : new AudioContext();
  $("sound").textContent = tones ? words.sound : words.silent;
  $("sound").setAttribute("aria-pressed", String(Boolean(tones)));
  if (tones) tone(660);
};
function tone(hertz) {
  const sound = tones.createOscillator(), loud = tones.createGain();
  sound.frequency.value = hertz;
  loud.gain.value = 0.2;
  sound.connect(loud).connect(tones.destination);
  sound.start();
  sound.stop(tones.currentTime + 0.35);
}

const NOT_SEEN = 4, HATCH = 8; // 64 cells of a tile are a multiple of the hatching's period
function tileAt(x, y) {
  const key = x + "," + y;
  let tile = map.tiles.get(key);
  if (!tile) {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = map.side;
    tile = { x, y, state: new Uint8Array(map.side * map.side), canvas, stale: true };
    map.tiles.set(key, tile);
  }
  return tile;
}
function paint(tile) {
  const side = map.side, image = new ImageData(side, side);
  const of = [null, rgba(colour.worked), rgba(colour.overlap), rgba(colour.missed), rgba(colour["not-seen"])];
  for (let row = 0; row < side; row++) {
    for (let column = 0; column < side; column++) {
      const state = tile.state[row * side + column], rgb = of[state];
      if (!rgb || (state === NOT_SEEN && (row + column) % HATCH > 2)) continue;
      const at = 4 * ((side - 1 - row) * side + column); // rows go north
      image.data[at] = rgb[0]; image.data[at + 1] = rgb[1]; image.data[at + 2] = rgb[2]; image.data[at + 3] = 255;
    }
  }
  tile.canvas.getContext("2d").putImageData(image, 0, 0);
  tile.stale = false;
}

async function takePicture(picture) {
  const bytes = Uint8Array.from(atob(picture.cells), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const cells = new Uint8Array(await new Response(stream).arrayBuffer());
  takePlace(picture);
  map.cell = picture.cell_m; map.side = picture.tile;
  map.tiles.clear();
  map.way = picture.way_m || [];
  const size = map.side * map.side;
  picture.tiles.forEach(([x, y], i) => tileAt(x, y).state.set(cells.subarray(i * size, (i + 1) * size)));
}
function takePlace(place) {
  map.origin = place.origin_m || null;
  map.background = place.background || null;
  map.tool = place.tool || null;
  map.field = place.field_m || [];
  map.headland = place.headland_m || [];
  $("source").textContent = map.background ? map.background.attribution : "";
}
function takeCells(tiles) {
  for (const [x, y, runs] of tiles) {
    const tile = tileAt(x, y);
    for (let i = 0; i < runs.length; i += 3) tile.state.fill(runs[i + 2], runs[i], runs[i] + runs[i + 1]);
    tile.stale = true;
  }
}

// The background: images of the tiles around, and those of two zooms less until they are here.
const images = new Map();
function imageOf(path) {
  let image = images.get(path);
  if (!image) {
    image = new Image();
    image.src = path;
    images.set(path, image);
    if (images.size > 300) images.delete(images.keys().next().value);
  }
  return image.complete && image.naturalWidth ? image : null;
}
function drawBackground(east, north, reach, pixelsPerMetre) {
  const { at, en_m: [e0, n0], to_m: [[a, b], [c, d]], zooms } = map.background;
  const unit = Math.hypot(a, c), det = a * d - b * c, de = east - e0, dn = north - n0;
  const x = at[0] + (d * de - b * dn) / det, y = at[1] + (a * dn - c * de) / det;
  const best = Math.min(zooms[1], Math.max(zooms[0], Math.round(Math.log2(unit * pixelsPerMetre / 256))));
  pen.save();
  pen.imageSmoothingEnabled = true;
  pen.globalAlpha = night ? 0.35 : 0.8;
  for (const zoom of new Set([Math.max(zooms[0], best - 2), best])) {
    const count = 2 ** zoom, around = reach / unit * count;
    if (around > 8) continue;  // a map of small tiles only, seen from far
    for (let row = Math.max(0, Math.floor(y * count - around)); row <= Math.min(count - 1, y * count + around); row++) {
      for (let column = Math.floor(x * count - around); column <= x * count + around; column++) {
        const image = imageOf(`tiles/${zoom}/${(column % count + count) % count}/${row}`); // the world goes on at 180°
        if (!image) continue;
        const dx = column / count - at[0], dy = row / count - at[1];
        pen.save();
        pen.transform(a / count, -c / count, b / count, -d / count, a * dx + b * dy - de, dn - c * dx - d * dy);
        pen.drawImage(image, 0, 0, 1.003, 1.003);
        pen.restore();
      }
    }
  }
  pen.restore();
}

// Events are taken in their order, the picture included, which is unpacked asynchronously.
let order = Promise.resolve();
let source = null;
function connect() {
  if (source) source.close();
  triedAt = performance.now();
  source = new EventSource("events");
  source.onopen = () => { heardAt = performance.now(); connected = true; };
  const on = (name, take) => source.addEventListener(name, (e) => {
    heardAt = performance.now(); connected = true;
    const content = JSON.parse(e.data);
    order = order.then(() => take(content)).catch((error) => console.error(error));
  });
  on("alive", () => {});
  on("picture", takePicture);
  on("place", takePlace);
  on("cells", takeCells);
  on("pose", (p) => {
    waiting = "";
    if (p.e_m !== undefined) {
      pose = p; poseAt = heardAt;
      const last = map.way[map.way.length - 1];
      if (!last || Math.hypot(last[0] - p.e_m, last[1] - p.n_m) > 1) map.way.push([p.e_m, p.n_m]);
      if (map.way.length > 5000) map.way.shift();
    }
    spot = p.antenna_m || null; // where the antenna is, while the heading is not known
    const state = p.tool;
    $("tool").dataset.state = state; $("tool").textContent = words[state];
    missing = p.missing;
    $("missing").replaceChildren(...missing.map((code) => Object.assign(document.createElement("li"), { textContent: words["missing-" + code] || code })));
    if (p.e_m === undefined) return;
    $("speed").innerHTML = number(3.6 * p.speed_mps, 1) + " <small>km/h</small>";
    $("fix").textContent = missing.includes("positions") ? number(p.position_age_s, 0) + " s" : words[p.fix] || p.fix;
    const off_m = 1.73 * p.sigma_m;  // 95 % of the positions lie this near, with errors alike in both directions
    $("sigma").innerHTML = (off_m < 1 ? number(100 * off_m, 0) + " <small>cm</small>" : number(off_m, 1) + " <small>m</small>");
    showEdges(p.edge_m || [null, null]);
    showLine(p);
    showAhead(p);
  });
  on("figures", (f) => {
    if (figures && f.dropped > figures.dropped) droppedAt = performance.now();
    figures = f;
    $("worked").innerHTML = hectares(f.worked_m2);
    $("left").innerHTML = f.left_m2 === null ? "–" : hectares(f.left_m2);
    $("overlap").innerHTML = hectares(f.overlap_m2);
    $("missed").innerHTML = hectares(f.missed_m2);
    $("unseen").innerHTML = hectares(f.not_seen_m2);
    $("dropped").textContent = number(f.dropped, 0);
    $("cell-unseen").classList.toggle("lost", f.not_seen_m2 >= 1);
    $("cell-dropped").classList.toggle("lost", f.dropped > 0);
    $("rate").innerHTML = f.rate_m2ps === null ? "–" : number(f.rate_m2ps * 0.36, 2) + " <small>ha/h</small>";
    const minutes = f.left_m2 !== null && f.rate_m2ps > 0.05 ? Math.round(f.left_m2 / f.rate_m2ps / 60) : null;
    $("togo").innerHTML = minutes === null ? "–" : Math.floor(minutes / 60) + ":" + String(minutes % 60).padStart(2, "0") + " <small>h</small>";
    warnings = f.warnings;
  });
  on("over", () => { isOver = true; });
  on("waiting", (what) => { waiting = words.waiting.replace("{what}", what[language]); });
  source.onerror = () => { connected = false; };
}
let warnings = [], missing = [];
const putAway = new Set();
const centimetres = (m) => number(Math.abs(100 * m), 0) + " cm";
const SHOWN_M = 0.5; // the half of a bar

// Ground between the ends of the tool and the passes beside it: a gap grows outwards from the middle, an overlap as well, in its own colour.
function showEdges(gaps) {
  $("edges").hidden = gaps[0] === null && gaps[1] === null;
  ["left", "right"].forEach((side, k) => {
    const gap = gaps[k], bar = $("bar-" + side), said = $("edge-" + side);
    bar.style.width = gap === null ? "0" : Math.min(50, 50 * Math.abs(gap) / SHOWN_M) + "%";
    bar.style[k ? "left" : "right"] = "50%";
    bar.className = gap > 0 ? "gap" : "over";
    said.className = gap === null ? "" : gap > 0.02 ? "gap" : "over";
    const small = Object.assign(document.createElement("small"), { textContent: gap === null ? "" : gap > 0 ? words.gap : words.overlap });
    said.replaceChildren(gap === null ? "–" : (k ? centimetres(gap) + " ▶" : "◀ " + centimetres(gap)), small);
  });
}
// How far the nearest parallel of the line from A to B is, to the left or the right of the tool's middle.
function showLine(p) {
  const shown = line.length === 2 && map.tool;
  $("lightbar").hidden = $("eye").hidden = !shown;
  if (!shown) return;
  const [a, b] = line, length = Math.hypot(b[0] - a[0], b[1] - a[1]), de = (b[0] - a[0]) / length, dn = (b[1] - a[1]) / length;
  const [e, n] = toolMiddle(p);
  const right = (e - a[0]) * dn - (n - a[1]) * de, width = map.tool.width_m;
  let off = right - width * Math.round(right / width);
  const heading = p.heading_deg * Math.PI / 180;
  if (Math.sin(heading) * de + Math.cos(heading) * dn < 0) off = -off;
  // The bar lies where the line is: to its side one has to go.
  const bar = $("bar-off"), share = Math.min(50, 50 * Math.abs(off) / SHOWN_M) + "%";
  bar.style.width = share;
  bar.style.left = off > 0 ? "auto" : "50%";
  bar.style.right = off > 0 ? "50%" : "auto";
  $("off-left").textContent = off > 0.01 ? "◀ " + centimetres(off) : "";
  $("off-right").textContent = off < -0.01 ? centimetres(off) + " ▶" : Math.abs(off) <= 0.01 ? "0 cm" : "";
}
function toolMiddle(p) {
  const heading = p.heading_deg * Math.PI / 180, [x, y] = map.tool ? map.tool.xy_m : [0, 0];
  return [p.e_m + x * Math.sin(heading) - y * Math.cos(heading), p.n_m + x * Math.cos(heading) + y * Math.sin(heading)];
}
// The way to the boundary straight ahead of the tool, where it is inside of the field.
function showAhead(p) {
  const heading = p.heading_deg * Math.PI / 180, [e, n] = toolMiddle(p), de = Math.sin(heading), dn = Math.cos(heading);
  const found = [];
  for (const ring of map.field) {
    for (let i = 1; i < ring.length; i++) {
      const [x0, y0] = [ring[i - 1][0] - e, ring[i - 1][1] - n], [x1, y1] = [ring[i][0] - e, ring[i][1] - n];
      const s0 = x0 * dn - y0 * de, s1 = x1 * dn - y1 * de;
      if ((s0 > 0) === (s1 > 0)) continue;
      const share = s0 / (s0 - s1), along = (x0 + share * (x1 - x0)) * de + (y0 + share * (y1 - y0)) * dn;
      if (along > 0) found.push(along);
    }
  }
  $("ahead").hidden = found.length % 2 === 0; // outside of the field a line crosses the boundary an even number of times
  if (found.length % 2) $("ahead").textContent = words.ahead.replace("{m}", number(Math.min(...found), Math.min(...found) < 10 ? 1 : 0));
}
const number = (value, digits) => value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
const hectares = (m2) => (m2 < 1000 ? number(m2, 0) + " <small>m²</small>" : number(m2 / 1e4, 2) + " <small>ha</small>");

const canvas = $("map"), pen = canvas.getContext("2d");
function draw() {
  requestAnimationFrame(draw);
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = colour.ground; pen.fillRect(0, 0, width, height);
  const now = performance.now(), age = pose && !isOver ? pose.delay_s + (now - poseAt) / 1000 : 0;
  say(age, now);
  if (!map.origin || !(pose || spot)) return;
  const here = spot ? { e_m: spot[0], n_m: spot[1], heading_deg: 0, turn_degps: 0, speed_mps: 0 } : pose;
  // Between two messages the vehicle goes on as it went; for half a second, not more.
  const ahead = connected && !isOver && !spot ? Math.min(0.5, (now - poseAt) / 1000) : 0;
  const heading = (here.heading_deg + here.turn_degps * ahead) * Math.PI / 180;
  const east = here.e_m + Math.sin(heading) * here.speed_mps * ahead, north = here.n_m + Math.cos(heading) * here.speed_mps * ahead;
  const scale = Math.min(width, height) / metres;
  pen.save();
  pen.translate(width / 2, height * (northUp ? 0.5 : 0.62));
  if (!northUp) pen.rotate(-heading);
  pen.scale(scale, scale);
  const side = map.cell * map.side, reach = 0.75 * Math.hypot(width, height) / scale + side;
  if (map.background) drawBackground(east, north, reach, scale * ratio);
  pen.imageSmoothingEnabled = false;
  for (const tile of map.tiles.values()) {
    const x = tile.x * side - east, y = tile.y * side - north;
    if (Math.hypot(x, y) > reach) continue;
    if (tile.stale) paint(tile);
    pen.drawImage(tile.canvas, x, -y - side, side * 1.002, side * 1.002);
  }
  const path = (places, closed) => {
    pen.beginPath();
    places.forEach(([e, n], i) => (i ? pen.lineTo(e - east, north - n) : pen.moveTo(e - east, north - n)));
    if (closed) pen.closePath();
    pen.stroke();
  };
  pen.strokeStyle = colour.boundary; pen.lineWidth = 4 / scale;
  for (const ring of map.field) path(ring, true);
  pen.lineWidth = 2 / scale; pen.setLineDash([10 / scale, 8 / scale]);
  for (const ring of map.headland) path(ring, true);
  pen.strokeStyle = colour.vehicle;
  if (line.length === 2) {
    const [a, b] = line, length = Math.hypot(b[0] - a[0], b[1] - a[1]), reachOf = 2 * reach + length;
    const de = (b[0] - a[0]) / length, dn = (b[1] - a[1]) / length, along = (east - a[0]) * de + (north - a[1]) * dn;
    const step = map.tool ? map.tool.width_m : 0, right = (east - a[0]) * dn - (north - a[1]) * de;
    const offset = step ? step * Math.round(right / step) : 0;
    const at = (s) => [a[0] + de * (along + s) + dn * offset, a[1] + dn * (along + s) - de * offset];
    path([at(-reachOf), at(reachOf)], false);
  }
  pen.setLineDash([]);
  pen.globalAlpha = 0.8;
  path([...map.way, [east, north]], false);
  pen.globalAlpha = 1;
  pen.rotate(heading);
  if (map.tool && !spot) drawTool(scale);
  pen.beginPath();
  const size = Math.max(1.4, 18 / scale);
  if (spot) pen.arc(0, 0, 0.6 * size, 0, 2 * Math.PI);
  else for (const [x, y] of [[0, -1.3], [0.8, 0.8], [0, 0.4], [-0.8, 0.8]]) pen.lineTo(x * size, y * size);
  pen.closePath();
  pen.fillStyle = colour.vehicle; pen.strokeStyle = colour.paper; pen.lineWidth = 3 / scale; pen.fill(); pen.stroke();
  pen.restore();
  showScale(scale);
}
// The tool's bar: full where it is down, hollow where it is up, dashed where that is not seen.
function drawTool(scale) {
  const [x, y] = map.tool.xy_m, half = map.tool.width_m / 2, thick = Math.max(0.25, 7 / scale), state = pose.tool;
  const box = [-y - half, -x - thick / 2, 2 * half, thick];
  pen.fillStyle = state === "down" ? colour["tool-down"] : colour.paper;
  pen.fillRect(...box);
  pen.strokeStyle = state === "down" ? colour.paper : state === "up" ? colour["tool-up"] : colour.ink;
  pen.lineWidth = 2.5 / scale;
  pen.setLineDash(state === "unknown" ? [5 / scale, 4 / scale] : []);
  pen.strokeRect(...box);
  pen.setLineDash([]);
  pen.strokeStyle = colour.ink; pen.lineWidth = 1.5 / scale;
  pen.beginPath(); pen.moveTo(0, 0); pen.lineTo(-y, -x - thick / 2); pen.stroke();
}
let scaleSaid = "";
function showScale(scale) {
  const length = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((m) => m * scale > 60) || 1000;
  const said = length + " m", wide = Math.round(length * scale) + "px";
  if (scaleSaid === said + wide) return;
  scaleSaid = said + wide;
  $("scale").textContent = said; $("scale").style.width = wide;
}
let saidAt = 0;
function say(age, now) {
  if (now - saidAt < 200) return;
  saidAt = now;
  const silent = (now - heardAt) / 1000;
  $("age").innerHTML = pose ? number(age, 1) + " <small>s</small>" : "–";
  const seconds = number(Math.round(pose ? age : silent), 0);
  const fill = (word, s) => words[word].replace("{seconds}", number(Math.ceil(s), 0));
  // A link that is cut may leave the connection open for minutes, so that no error comes: then it is made anew.
  if (silent > 5 || !connected) { if (now - triedAt > 2000) connect(); }
  const warning = warnings.find((one) => !putAway.has(one.code));
  let text = "", level = "note", code = "";
  if (heardAt && (!connected || silent > 5)) [text, level] = [words.cut.replace("{age}", seconds), isOver ? "note" : "bad"];
  else if (isOver || (figures && figures.over)) text = figures && figures.waits_s > 0 && !isOver ? fill("over-waits", figures.waits_s) : words.over;
  else if (waiting) [text, level] = [waiting, heardAt ? "bad" : "note"];
  else if (pose && age > 2) [text, level] = [words.stale.replace("{age}", seconds), "bad"];
  else if (now - droppedAt < DROPPED_SAID_MS) [text, level] = [words["lost-scans"], "bad"];
  else if (pose && missing.includes("positions")) [text, level] = [fill("lost-positions", pose.position_age_s), "bad"];
  else if (pose && missing.includes("tool") && Math.abs(pose.speed_mps) > 0.2) [text, level] = [words["lost-tool"], "bad"];
  else if (warning) [text, code] = [warning[language], warning.code];
  else if (figures && figures.waits_s > 0 && !missing.includes("tool-learning")) text = fill("repair", figures.waits_s);
  $("said").textContent = text; $("alarm").hidden = !text; $("alarm").dataset.level = level;
  $("hide").hidden = !code;
  $("hide").onclick = () => { putAway.add(code); saidAt = 0; };
  const isBad = Boolean(text) && level === "bad";
  if (isBad && tones && now - tonedAt > 5000) { tonedAt = now; tone(880); }
  if (!isBad) tonedAt = 0;
}
const DROPPED_SAID_MS = 8000;
setNight();
setLine(line);
$("sound").textContent = words.silent;
connect();
draw();
// Keeps the screen awake where the browser allows it: only for https and localhost.
if (navigator.wakeLock) {
  const awake = () => { if (document.visibilityState === "visible") navigator.wakeLock.request("screen").catch(() => {}); };
  document.addEventListener("visibilitychange", awake);
  awake();
}
