// The map of a shared result: layers, figures, measuring. All data come from data.js, so that it also works from disk.
import OlMap from "ol/Map.js";
import View from "ol/View.js";
import Feature from "ol/Feature.js";
import GeoJSON from "ol/format/GeoJSON.js";
import Draw from "ol/interaction/Draw.js";
import LayerGroup from "ol/layer/Group.js";
import ImageLayer from "ol/layer/Image.js";
import VectorLayer from "ol/layer/Vector.js";
import Static from "ol/source/ImageStatic.js";
import VectorSource from "ol/source/Vector.js";
import Projection from "ol/proj/Projection.js";
import ScaleLine from "ol/control/ScaleLine.js";
import Zoom from "ol/control/Zoom.js";
import { Circle, Fill, Stroke, Style, Text } from "ol/style.js";

const data = window.furrowmapData;
const byId = (id) => document.getElementById(id);
const PIXELS_PER_MM = 96 / 25.4;
const PHONE = matchMedia("(max-width: 700px)");
let language = startLanguage();

function startLanguage() {
  const asked = new URLSearchParams(location.search).get("lang") ?? data.language;
  const known = (asked ? [asked] : navigator.languages).map((one) => one.split("-")[0]);
  return known.find((one) => data.languages[one]) ?? "en";
}

/** A text in the reader's language; texts of the user's own stay as they are. */
function say(text) {
  return data.languages[language].texts[text] ?? text;
}

/** Numbers in English notation with the marks of the reader's language. */
function inMarks(text) {
  const { marks } = data.languages[language];
  return text.replace(/(\d)([.,])(?=\d)/g, (_, digit, mark) => digit + (marks[mark] ?? mark));
}

/** A text of a legend, which may be a number with its unit. */
function sayKey(text) {
  return data.languages[language].texts[text] ?? inMarks(text);
}

/** An element with text; text is never read as HTML. */
function element(tag, text = "", className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

// ---- the map

// The session's own CRS: a plane in metres. Lengths on the ground are those of the plane divided by its scale.
const projection = new Projection({
  code: "session", units: "m", metersPerUnit: 1 / data.crs.scale, extent: data.extent,
});
const [west, south, east, north] = data.extent;
const margin = Math.max(east - west, north - south);
const view = new View({
  projection,
  extent: [west - margin, south - margin, east + margin, north + margin],
  constrainOnlyCenter: true,
  smoothExtentConstraint: false,
  minResolution: 0.002,
});

function olStyle(symbol) {
  const width = symbol.width_mm * PIXELS_PER_MM;
  const stroke = symbol.stroke
    ? new Stroke({ color: symbol.stroke, width: Math.max(width, 1), lineDash: symbol.dashed ? [2, 5] : undefined })
    : undefined;
  const fill = symbol.fill ? new Fill({ color: symbol.fill }) : undefined;
  const image = new Circle({ radius: Math.max(3, (symbol.size_mm * PIXELS_PER_MM) / 2), stroke, fill });
  return new Style({ stroke, fill, image });
}

function nameStyle(name, overflow) {
  const text = new Text({
    text: name, font: "600 13px system-ui, sans-serif", overflow,
    fill: new Fill({ color: "#282828" }), stroke: new Stroke({ color: "#ffffffdd", width: 4 }),
  });
  return new Style({ text });
}

const reader = new GeoJSON();

function features(layer) {
  return layer.features.map((one) => {
    const feature = new Feature(reader.readGeometry(one.geometry));
    feature.set("style", olStyle(layer.symbols[one.symbol]));
    if (one.label) feature.set("name style", nameStyle(one.label, layer.names_overflow));
    if (one.measured) feature.set("measured", one.label);
    feature.set("shared", { layer, one });
    return feature;
  });
}

function shownName(feature) {
  const style = feature.get("name style");
  const measured = feature.get("measured");
  if (measured) style.getText().setText(inMarks(measured));
  return style;
}

const nameLayers = [];

/** A layer that is hidden at first gets its features when it is first shown. Its names lie above all layers. */
function vectorLayer(layer) {
  const source = new VectorSource();
  const shapes = new VectorLayer({ source, style: (one) => one.get("style"), updateWhileInteracting: true });
  const names = new VectorLayer({ source, style: shownName, declutter: true, zIndex: 1 });
  nameLayers.push(names);
  const made = new LayerGroup({ layers: [shapes, names], visible: layer.shown });
  if (layer.shown) source.addFeatures(features(layer));
  else made.once("change:visible", () => source.addFeatures(features(layer)));
  return made;
}

function pictureLayer(layer) {
  return new ImageLayer({
    source: new Static({ url: layer.file, imageExtent: layer.extent, projection, interpolate: true }),
    className: layer.multiply ? "ol-layer multiply" : "ol-layer",
    visible: layer.shown,
  });
}

const drawn = data.layers.map((layer) => (layer.features ? vectorLayer(layer) : pictureLayer(layer)));
const sketch = new VectorLayer({
  source: new VectorSource(),
  style: new Style({
    stroke: new Stroke({ color: "#c2185b", width: 3 }), fill: new Fill({ color: "#c2185b22" }),
    image: new Circle({ radius: 5, fill: new Fill({ color: "#c2185b" }) }),
  }),
});
const map = new OlMap({
  target: "map",
  layers: [...[...drawn].reverse(), sketch],
  view,
  controls: [new Zoom({ zoomInTipLabel: "+", zoomOutTipLabel: "−" }), new ScaleLine({ minWidth: 72 })],
});
map.once("rendercomplete", () => {
  performance.mark("first-picture");
  document.body.dataset.map = "shown";
});

function showAll() {
  view.fit(data.extent, { padding: [56, 16, 48, 16], size: map.getSize() });
}
showAll();
window.furrowmapPage = { map, showAll };

// ---- what a tap shows

const MEASURES = new Set([...data.measures, "Perimeter"]);

function showCard(title, rows) {
  const card = byId("card");
  card.replaceChildren();
  card.hidden = !title;
  if (!title) return;
  const close = element("button", "×", "close");
  close.setAttribute("aria-label", say("Close"));
  close.addEventListener("click", () => (mode ? endMeasuring() : showCard("")));
  card.append(close, element("h2", title));
  const list = element("dl");
  for (const [name, value] of rows) {
    list.append(element("dt", say(name)), element("dd", MEASURES.has(name) ? inMarks(value) : say(value)));
  }
  card.append(list);
}

map.on("singleclick", (event) => {
  if (mode) return;
  const found = map.getFeaturesAtPixel(event.pixel, { hitTolerance: 8 }).find((feature) => feature.get("shared"));
  if (!found) return showCard("");
  const { layer, one } = found.get("shared");
  showCard(say(layer.title), one.rows);
});

// ---- measuring

let mode = "";
let draw = null;

function inMetres(lengthInPlane) {
  const length = lengthInPlane / data.crs.scale;
  return length < 1000 ? `${length.toFixed(2)} m` : `${(length / 1000).toFixed(3)} km`;
}

function areaWords(areaInPlane) {
  const area = areaInPlane / data.crs.scale ** 2;
  return area < 1000 ? `${area.toFixed(1)} m²` : `${(area / 10000).toFixed(3)} ha`;
}

function showMeasured(geometry) {
  const rows =
    mode === "area"
      ? [["Area", areaWords(geometry.getArea())], ["Perimeter", inMetres(perimeter(geometry))]]
      : [["Length", inMetres(geometry.getLength())]];
  showCard(say(mode === "area" ? "Measure an area" : "Measure a distance"), [
    ...rows, ["Tap to set points; tap the last one twice to end.", ""],
  ]);
}

function perimeter(polygon) {
  const ring = polygon.getLinearRing(0).getCoordinates();
  return ring.slice(1).reduce((sum, [x, y], i) => sum + Math.hypot(x - ring[i][0], y - ring[i][1]), 0);
}

function measure(wanted) {
  const again = mode === wanted;
  endMeasuring();
  if (again) return;
  showMap();
  mode = wanted;
  draw = new Draw({ source: sketch.getSource(), type: mode === "area" ? "Polygon" : "LineString" });
  draw.on("drawstart", (event) => {
    sketch.getSource().clear();
    const geometry = event.feature.getGeometry();
    geometry.on("change", () => showMeasured(geometry));
  });
  map.addInteraction(draw);
  showCard(say(mode === "area" ? "Measure an area" : "Measure a distance"), [
    ["Tap to set points; tap the last one twice to end.", ""],
  ]);
  pressed();
}

function endMeasuring() {
  if (draw) map.removeInteraction(draw);
  draw = null;
  mode = "";
  sketch.getSource().clear();
  showCard("");
  pressed();
}

function pressed() {
  byId("distance").setAttribute("aria-pressed", String(mode === "distance"));
  byId("area").setAttribute("aria-pressed", String(mode === "area"));
  const solid = !byId("cloud").hidden;
  byId("solid").setAttribute("aria-pressed", String(solid));
  byId("on-map").disabled = solid;
  byId("points-alone").hidden = !solid;
}

// ---- the cloud in three dimensions, read when it is first asked for

let cloudView = null;

function script(name) {
  return new Promise((resolve, reject) => {
    const made = document.createElement("script");
    made.src = name;
    made.addEventListener("load", resolve);
    made.addEventListener("error", () => reject(new Error(name)));
    document.head.append(made);
  });
}

function showMap() {
  byId("cloud").hidden = true;
  byId("map").hidden = false;
  map.updateSize();
  pressed();
}

async function showCloud() {
  if (!byId("cloud").hidden) return showMap();
  endMeasuring();
  byId("map").hidden = true;
  byId("cloud").hidden = false;
  pressed();
  if (cloudView) return cloudView.resize();
  const note = byId("cloud-note");
  note.textContent = say("Reading the points…");
  try {
    await script("cloud.js");
    await script(data.cloud.file);
    cloudView = window.furrowmapCloud.show(byId("cloud-canvas"), window.furrowmapPoints, data.extent);
    note.textContent = "";
    cloudButtons();
    document.body.dataset.cloud = "shown";
  } catch (error) {
    console.warn(error);
    note.textContent = say("This browser cannot draw in three dimensions (WebGL is missing).");
  }
}

function cloudButtons() {
  const box = byId("cloud-key");
  box.replaceChildren();
  if (!cloudView) return;
  const choices = element("div", "", "choices");
  for (const name of cloudView.colourings) {
    const button = element("button", say(name));
    button.setAttribute("aria-pressed", String(name === cloudView.colouring()));
    button.addEventListener("click", () => {
      cloudView.colour(name);
      cloudButtons();
    });
    choices.append(button);
  }
  box.append(choices);
  const list = element("ul", "", "key");
  for (const { colour, label } of cloudView.legend()) list.append(keyItem({ fill: colour }, label));
  const classes = element("div", "", "choices");
  for (const { code, label, shown } of cloudView.classes()) {
    const choice = element("label");
    const tick = document.createElement("input");
    tick.type = "checkbox";
    tick.checked = shown;
    tick.addEventListener("change", () => cloudView.showClass(code, tick.checked));
    choice.append(tick, document.createTextNode(say(label)));
    classes.append(choice);
  }
  const count = (number) => number.toLocaleString(language);
  box.append(list, classes, element("p", `${count(data.cloud.points)} / ${count(data.cloud.of)} ${say("points")}`, "soft"));
}

// ---- the panel

function swatch(symbol) {
  const ns = "http://www.w3.org/2000/svg";
  const drawing = document.createElementNS(ns, "svg");
  drawing.setAttribute("viewBox", "0 0 16 11");
  drawing.setAttribute("aria-hidden", "true");
  const box = document.createElementNS(ns, "rect");
  const set = (name, value) => box.setAttribute(name, value);
  set("width", "16");
  set("height", "11");
  set("fill", symbol.fill ?? symbol.stroke ?? "none");
  if (symbol.fill && symbol.stroke) {
    set("stroke", symbol.stroke);
    set("stroke-width", "2");
  }
  drawing.append(box);
  return drawing;
}

// Text whose figures stay on one line.
function unbroken(text) {
  return text.replace(/± (?=\d)/g, "±\u00a0").replace(/(\d) (?=[%±])/g, "$1\u00a0");
}

function keyItem(symbol, label) {
  const item = element("li");
  item.append(swatch(symbol), document.createTextNode(sayKey(label)));
  return item;
}

function layerRow(layer, number) {
  const row = element("li");
  const label = element("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.name = layer.name;
  box.checked = drawn[number].getVisible();
  box.addEventListener("change", () => drawn[number].setVisible(box.checked));
  const alone = layer.features && !layer.legend.length && layer.symbols.length === 1;
  label.append(box, ...(alone ? [swatch(layer.symbols[0])] : []), document.createTextNode(say(layer.title)));
  row.append(label);
  const key = layer.features
    ? layer.legend.map(({ label, symbol }) => keyItem(layer.symbols[symbol], label))
    : layer.legend.map(({ label, colour }) => keyItem({ fill: colour }, label));
  if (key.length) {
    const list = element("ul", "", "key");
    list.append(...key);
    row.append(list);
  }
  return row;
}

function alarmBox({ text, follows }) {
  const box = element("div", "", "alarm");
  box.append(element("p", text[language]));
  if (follows.length) {
    const list = element("ul");
    list.append(...follows.map((one) => element("li", one[language])));
    box.append(element("p", say("This explains:"), "then"), list);
  }
  return box;
}

// Without a font of the language, as of Japanese, every letter is the same box.
function hasFont(name) {
  const drawn = (letter) => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 24;
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.font = "20px system-ui, sans-serif";
    pen.fillText(letter, 2, 20);
    return canvas.toDataURL();
  };
  return drawn(name[0]) !== drawn(name[1]);
}

function fillPanel() {
  document.documentElement.lang = language;
  document.title = data.title || say("Field report");
  byId("title").textContent = document.title;
  byId("language").value = language;
  for (const one of document.querySelectorAll("[data-say]")) one.textContent = unbroken(say(one.dataset.say));
  for (const one of document.querySelectorAll("[data-label]")) one.setAttribute("aria-label", say(one.dataset.label));
  byId("when").textContent = data.when;
  byId("alarms").replaceChildren(...data.alarms.map(alarmBox));
  byId("figures").replaceChildren(
    ...data.figures.map(({ value, name, loud }) => {
      const box = element("div", "", loud ? "loud" : "");
      box.append(element("b", value[language]), element("span", unbroken(name.map(say).join(" "))));
      return box;
    }),
  );
  byId("notes").replaceChildren(...data.notes.map((text) => element("p", text[language])));
  byId("layers").replaceChildren(...data.layers.map(layerRow));
  byId("warnings").replaceChildren(...data.warnings.map((text) => element("li", text[language])));
  byId("warnings-count").textContent = String(data.warnings.length);
  byId("about").replaceChildren(...data.about.map(([name, value]) => element("p", `${say(name)}: ${say(value)}`)));
  byId("solid").hidden = !data.cloud;
  cloudButtons();
}

function openPanel(open) {
  document.body.classList.toggle("panel-open", open);
  byId("menu").setAttribute("aria-expanded", String(open));
  map.updateSize();
}

byId("menu").addEventListener("click", () => openPanel(!document.body.classList.contains("panel-open")));
byId("language").addEventListener("change", () => {
  language = byId("language").value;
  showCard("");
  nameLayers.forEach((layer) => layer.changed());
  fillPanel();
});
byId("distance").addEventListener("click", () => measure("distance"));
byId("area").addEventListener("click", () => measure("area"));
byId("whole").addEventListener("click", () => (byId("cloud").hidden ? showAll() : cloudView?.whole()));
byId("solid").addEventListener("click", showCloud);
new ResizeObserver(() => cloudView?.resize()).observe(byId("cloud-view"));
for (const [code, { name }] of Object.entries(data.languages)) {
  const shown = hasFont(name) ? name : new Intl.DisplayNames(["en"], { type: "language" }).of(code);
  byId("language").append(new Option(shown, code));
}
fillPanel();
openPanel(!PHONE.matches);
showAll();
