// Each figure can be saved: the picture as SVG or PNG, what is drawn as CSV.
(() => {
  "use strict";
  const save = (name, blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };

  /** The picture with the colours of the page in it, and a size of its own. */
  function picture(svg) {
    const copy = svg.cloneNode(true);
    const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    for (const [name, value] of [["xmlns", "http://www.w3.org/2000/svg"], ["width", width], ["height", height], ["font-family", "sans-serif"]]) copy.setAttribute(name, value);
    const style = getComputedStyle(document.documentElement);
    const text = new XMLSerializer().serializeToString(copy);
    return { width, height, text: text.replace(/var\((--\w+),(#[0-9a-f]{6})\)/g, (whole, name, given) => style.getPropertyValue(name).trim() || given) };
  }

  async function png(svg) {
    const { width, height, text } = picture(svg);
    const image = new Image();
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [2 * width, 2 * height];
    const context = canvas.getContext("2d");
    context.fillStyle = getComputedStyle(document.body).backgroundColor;
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  }

  /** Columns of whatever is drawn, by the path of their names. */
  function columns(value, path, found) {
    if (Array.isArray(value) && !value.some((item) => item !== null && typeof item === "object")) found.push([path, value]);
    else if (value !== null && typeof value === "object")
      for (const [key, item] of Object.entries(value)) columns(item, path ? `${path}.${key}` : key, found);
    else found.push([path, [value]]);
    return found;
  }

  function csv(figure) {
    const found = columns(JSON.parse(figure.dataset.values), "", []);
    const cell = (value) => (value === null || value === undefined ? "" : /[",\n]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : String(value));
    const rows = [found.map(([name]) => cell(name)).join(",")];
    for (let i = 0; i < Math.max(0, ...found.map(([, values]) => values.length)); i += 1) rows.push(found.map(([, values]) => cell(values[i])).join(","));
    return `${rows.join("\n")}\n`;
  }

  document.querySelectorAll("figure[data-name]").forEach((figure, place) => {
    const svg = figure.querySelector("svg");
    if (!svg) return;
    const name = `${figure.dataset.name || "figure"}-${place + 1}`;
    const kinds = {
      SVG: async () => new Blob([picture(svg).text], { type: "image/svg+xml" }),
      PNG: () => png(svg),
      CSV: async () => new Blob([csv(figure)], { type: "text/csv" }),
    };
    const box = document.createElement("p");
    box.className = "save";
    for (const [kind, make] of Object.entries(kinds)) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = kind;
      button.setAttribute("aria-label", `Save ${kind === "CSV" ? "the data" : "the picture"} as ${kind}`);
      button.addEventListener("click", async () => save(`${name}.${kind.toLowerCase()}`, await make()));
      box.append(button);
    }
    figure.append(box);
  });
})();
