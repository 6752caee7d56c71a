// The blocks that were rejected, or kept with a flag, and why.

import { get, machinePath } from "./api.js";
import { figure, sayInstead } from "./chart.js";
import { fill, h, table } from "./dom.js";
import * as fmt from "./fmt.js";
import { FLAGS, blockSentence } from "./words.js";

const SHOWN = 50;

export class Blocks {
  /** @param options machine, zone(), info(), onBlocks(blocks) */
  constructor(options) {
    this.options = options;
    const box = figure("Rejected and flagged blocks");
    this.element = box.element;
    this.body = box.body;
  }

  async load() {
    try {
      this.data = await get(`${machinePath(this.options.machine)}/blocks?limit=500`);
    } catch (error) {
      sayInstead(this.body, `The ledger could not be read: ${error.message}`, () => this.load());
      return;
    }
    const source = this.options.info()?.source;
    this.blocks = this.data.blocks
      .filter((block) => !source || block.source === source)
      .map((block) => ({ ...block, rejected: !FLAGS.includes(block.status) }));
    this.draw();
    this.options.onBlocks(this.blocks);
  }

  draw() {
    if (!this.data) return;
    const dated = this.options.info()?.dated;
    const counts = Object.entries(this.data.counts ?? {}).filter(([status, many]) => status !== "ok" && many > 0);
    const ok = this.data.counts?.ok ?? 0;
    const summary = h(
      "p",
      { class: "note" },
      `${fmt.counted(ok, "block")} of this machine accepted`,
      counts.map(([status, many]) => `, ${fmt.count(many)} ${status.replaceAll("_", " ")}`),
      this.data.pending ? `; ${fmt.counted(this.data.pending, "block")} waiting` : "",
      ".",
    );
    if (!this.blocks.length) {
      fill(this.body, summary, h("p", null, "No block of this channel's source was rejected or flagged."));
      return;
    }
    const zone = this.options.zone();
    const rows = this.blocks.slice(0, SHOWN).map((block) => [
      fmt.moment(block.time_s, { dated, zone }), String(block.block), block.name ?? "",
      h(
        "span",
        { class: block.rejected ? "wrong" : "" },
        `${block.rejected ? "rejected" : "flagged"}: ${block.status.replaceAll("_", " ")}`,
      ), block.reason || blockSentence(block.status),
    ]);
    fill(
      this.body,
      summary,
      table("Blocks rejected or flagged, newest first", ["Time", "Block", "Name", "Verdict", "Why"], rows),
      this.blocks.length > SHOWN ? h("p", { class: "note" }, `the newest ${SHOWN} of ${fmt.count(this.blocks.length)}`) : null,
    );
  }
}
