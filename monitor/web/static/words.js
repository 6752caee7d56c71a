// Words and features as the server gives them: monitor/words is where they stand.

const WORDS = JSON.parse(document.getElementById("words").textContent);

/** Name and meaning of each status after NAMUR NE 107, worst first. */
export const STATES = WORDS.states;
export const STATE_ORDER = Object.keys(STATES);
export const knownState = (state) => (Object.hasOwn(STATES, state ?? "") ? state : "no_data");
export const stageWord = (stage) => WORDS.stages[stage] ?? "";

export const PART_NAMES = WORDS.parts;
export const PARTS = Object.keys(PART_NAMES);
export const LINE_NAMES = WORDS.lines;

const GEAR = "gear:";

/** The damaged part, or the wheel of a gear; two where they cannot be told apart. */
export const faultWords = (fault) => (fault?.startsWith(GEAR) ? `gear ${fault.slice(GEAR.length).split("|").join(" or ")}`
  : fault ? fault.split("|").map((part) => PART_NAMES[part] ?? part).join(" or ") : "");

/** The damaged part of the bearing: a wheel that is named may be said in its place. */
export const bearingFault = (status) => (status?.fault?.startsWith(GEAR) ? status.bearing_fault : status?.fault);
export const gearSentence = (status) => WORDS.gears[status] ?? status ?? NONE;
export const gearKind = (kind) => WORDS.gear_kinds[kind] ?? "";

/** What a name is, a verdict or a hint, and why; "" without a name. */
export const baseWord = (basis) => WORDS.bases[basis]?.[0] ?? "";
export const baseSentence = (basis) => WORDS.bases[basis]?.[1] ?? "";

/** Whose damage raises the level of a bearing without a part of its own; "" for that of none. */
export const levelSentence = (bearing) => (bearing ? `${WORDS.level_of} ${bearing}` : "");

const NONE = "no value was computed yet";
export const edvSentence = (status) => (status ? WORDS.edv[status] ?? status : NONE);
export const ttaSentence = (status) => (status ? WORDS.tta[status] ?? status : NONE);
export const alarmLevel = (source) => WORDS.alarm_levels[source] ?? "the alarm level";
export const velocitySentence = (status) => WORDS.velocity[status] ?? status;
export const rotationSentence = (status) => WORDS.rotation[status] ?? status;
export const domainWord = (domain) => WORDS.domains[domain ?? "hertz"] ?? "";
export const zoneSentence = (zone) => WORDS.zones[zone] ?? "";
export const ttSentence = (status) => (status ? WORDS.tt[status] ?? status : NONE);

/** What a relative V_eq is a multiple of. */
export const RELATIVE = WORDS.relative;

export const FLAGS = ["flat", "stopped", "clipped", "gap", "clock", "late", "out_of_order", "outside_speed", "filled"];
export const blockSentence = (status) => WORDS.blocks[status] ?? status;

export const CHARTS = WORDS.charts;
export const FEATURES = WORDS.features;
export const featureWord = (name) => FEATURES[name]?.label ?? name.replaceAll("_", " ");
export const daemonSentence = (status) => WORDS.daemon[status] ?? "The daemon does not run";

/** What a column of a recording is read as, and by what a reading is known. */
export const columnKind = (kind) => WORDS.columns[kind] ?? kind;
export const originWord = (origin) => WORDS.origins[origin] ?? origin;
