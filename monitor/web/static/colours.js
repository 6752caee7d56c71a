// A colour map whose steps look equal: straight in lightness of OKLab, from the ground of the theme to its contrary.

function oklabToRgb(lightness, a, b) {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const linear = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  return linear.map((value) => {
    const inside = Math.min(1, Math.max(0, value));
    return Math.round(255 * (inside <= 0.0031308 ? 12.92 * inside : 1.055 * inside ** (1 / 2.4) - 0.055));
  });
}

/** Red, green and blue (0 to 255) of a share from 0 to 1. */
function step(share, dark) {
  const lightness = dark ? 0.22 + 0.73 * share : 0.985 - 0.72 * share;
  // From blue over green to yellow on a dark ground; from white over cyan to deep blue on a light one.
  const hue = ((dark ? 255 - 150 * share : 190 + 85 * share) * Math.PI) / 180;
  const chroma = dark ? 0.02 + 0.1 * Math.sin(Math.PI * (0.05 + 0.75 * share)) : 0.004 + 0.115 * Math.sin(
    (Math.PI / 2) * Math.min(1, share * 1.2),
  );
  return oklabToRgb(lightness, chroma * Math.cos(hue), chroma * Math.sin(hue));
}

const tables = new Map();

/** 256 colours as 32-bit words for image data. */
export function colourTable(dark) {
  if (!tables.has(dark)) {
    const bytes = new Uint8ClampedArray(1024);
    for (let i = 0; i < 256; i += 1) bytes.set([...step(i / 255, dark), 255], 4 * i);
    tables.set(dark, new Uint32Array(bytes.buffer));
  }
  return tables.get(dark);
}

/** One colour for a style sheet. */
export function colourAt(share, dark) {
  const [r, g, b] = step(Math.min(1, Math.max(0, share)), dark);
  return `rgb(${r},${g},${b})`;
}

/** Whether the page is dark now. */
export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}
