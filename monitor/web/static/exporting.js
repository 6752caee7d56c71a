// Pictures and data of a chart as files: PNG as it is on the screen, SVG and CSV from the data.

import { colour } from "./prefs.js";
import { h } from "./dom.js";
import * as fmt from "./fmt.js";

const SVG_SIZE = [900, 420];
const MARGIN = { left: 76, right: 20, top: 54, bottom: 52 };

/** Let the reader keep a file. */
export function save(name, blob) {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** The buttons; `chart()` gives {name, title, x, y, columns, canvas, log} or null, where columns are [heading, values]. */
export function exportButtons(chart, kinds = ["PNG", "SVG", "CSV"]) {
  const button = (kind, make, what) => h(
    "button",
    {
      type: "button",
      "aria-label": `Save ${what} as ${kind}`,
      onclick: async () => {
        const found = chart();
        if (found) save(`${found.name}.${kind.toLowerCase()}`, await make(found));
      },
    },
    kind,
  );
  const all = {
    PNG: () => button("PNG", png, "the picture"),
    SVG: () => button("SVG", async (found) => new Blob([svg(found)], { type: "image/svg+xml" }), "the picture"),
    CSV: () => button("CSV", async (found) => new Blob([csv(found)], { type: "text/csv" }), "the data"),
  };
  return h("span", { class: "export", role: "group", "aria-label": "Save" }, kinds.map((kind) => all[kind]()));
}

/** Data as CSV: a comment with the title, the headings with units, a row for each point. */
export function csv({ title, columns }) {
  const cell = (value) => (fmt.isNumber(value) ? String(value) : "");
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const rows = columns[0][1].map((_, i) => columns.map(([, values]) => cell(values[i])).join(","));
  return [`# ${title}`, columns.map(([heading]) => quoted(heading)).join(","), ...rows, ""].join("\n");
}

/** The chart as it stands on the screen, on its ground and under its title. */
async function png({ title, canvas }) {
  const scale = devicePixelRatio;
  const head = Math.round(30 * scale);
  const picture = h("canvas", { width: canvas.width, height: canvas.height + head });
  const context = picture.getContext("2d");
  context.fillStyle = colour("surface");
  context.fillRect(0, 0, picture.width, picture.height);
  context.fillStyle = colour("text");
  context.font = `${Math.round(13 * scale)}px system-ui, sans-serif`;
  context.fillText(title, 10 * scale, 20 * scale, picture.width - 20 * scale);
  context.drawImage(canvas, 0, head);
  return new Promise((resolve) => picture.toBlob(resolve, "image/png"));
}

/** A line chart as SVG with axes, units and a legend. */
export function svg({ title, x, y, columns, log, marks = [], range }) {
  const [width, height] = SVG_SIZE;
  const inner = { width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
  const [from, to] = range ?? ends(columns[0][1], false);
  const shown = columns[0][1].map((value) => value >= from && value <= to);
  const [low, high] = ends(columns.slice(1).flatMap(([, values]) => values.filter((_, i) => shown[i])), log);
  const across = (value) => MARGIN.left + ((value - from) / (to - from || 1)) * inner.width;
  const up = log ? (value) => Math.log10(value) : (value) => value;
  const down = (value) => MARGIN.top + inner.height * (1 - (up(value) - up(low)) / (up(high) - up(low) || 1));
  const text = (value) => value.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
  const inks = [colour("series"), colour("series-two")];
  const parts = [
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" font-family="sans-serif" font-size="12">`,
    `<rect width="${width}" height="${height}" fill="${colour("surface")}"/>`,
    `<text x="${MARGIN.left}" y="20" font-size="14" fill="${colour("text")}">${text(title)}</text>`,
  ];
  const label = (place, anchor, words) => `<text ${place} text-anchor="${anchor}" fill="${colour("axis")}">${text(words)}</text>`;
  const rule = (x1, y1, x2, y2, ink, dash = "") =>
    `<line x1="${x1.toFixed(1)}" y1="${y1.toFixed(1)}" x2="${x2.toFixed(1)}" y2="${y2.toFixed(1)}" stroke="${ink}"${dash}/>`;
  for (const value of ticks(from, to)) {
    parts.push(rule(across(value), MARGIN.top, across(value), height - MARGIN.bottom, colour("grid")));
    parts.push(label(`x="${across(value).toFixed(1)}" y="${height - MARGIN.bottom + 16}"`, "middle", fmt.number(value, 6)));
  }
  for (const value of log ? decades(low, high) : ticks(low, high)) {
    parts.push(rule(MARGIN.left, down(value), width - MARGIN.right, down(value), colour("grid")));
    parts.push(label(`x="${MARGIN.left - 6}" y="${(down(value) + 4).toFixed(1)}"`, "end", fmt.number(value, 4)));
  }
  for (const mark of marks) if (mark.x >= from && mark.x <= to) {
    parts.push(rule(across(mark.x), MARGIN.top, across(mark.x), height - MARGIN.bottom, mark.ink, ' stroke-dasharray="4 3"'));
    if (mark.label) parts.push(`<text x="${(across(mark.x) + 3).toFixed(1)}" y="${MARGIN.top + 10}" font-size="10" fill="${mark.ink}">${text(mark.label)}</text>`);
  }
  columns.slice(1).forEach(([heading, values], place) => {
    const ink = inks[place % inks.length];
    let path = "";
    let pen = "M";
    values.forEach((value, i) => {
      if (!shown[i] || !fmt.isNumber(value) || (log && value <= 0)) pen = "M";
      else {
        path += `${pen}${across(columns[0][1][i]).toFixed(1)} ${down(Math.max(value, low)).toFixed(1)}`;
        pen = "L";
      }
    });
    parts.push(`<path d="${path}" fill="none" stroke="${ink}" stroke-width="1"/>`);
    parts.push(`<text x="${MARGIN.left + place * 260}" y="40" fill="${ink}">${text(heading)}</text>`);
  });
  parts.push(label(`x="${MARGIN.left + inner.width / 2}" y="${height - 12}"`, "middle", x));
  parts.push(label(`transform="translate(16 ${MARGIN.top + inner.height / 2}) rotate(-90)"`, "middle", y));
  return [...parts, "</svg>"].join("\n");
}

function ends(values, log) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) if (fmt.isNumber(value) && (!log || value > 0)) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return [0, 1];
  return log ? [Math.max(low, high * 1e-6), high] : [low, high];
}

/** Round values between two ends, about eight. */
function ticks(from, to) {
  const raw = (to - from) / 8 || 1;
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * unit).find((n) => n >= raw);
  const found = [];
  for (let k = Math.ceil(from / step); k * step <= to + 1e-9 * step; k += 1) found.push(Number((k * step).toPrecision(12)));
  return found;
}

function decades(low, high) {
  const found = [];
  for (let k = Math.ceil(Math.log10(low)); k <= Math.log10(high); k += 1) found.push(10 ** k);
  return found.length > 1 ? found : [low, high];
}
