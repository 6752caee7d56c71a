// Statuses in the words of the people who read them.

/** Worst first: a known danger outranks silence, silence and bad data outrank what can no longer be believed. */
export const STATES = {
  failure: ["Failure", "a danger stands, or the end of life was reached"],
  no_data: ["No data", "no block comes"],
  bad_data: ["Bad data", "too many blocks are rejected or flagged"],
  out_of_specification: ["Out of specification", "how large the damage is cannot be said"],
  maintenance_required: ["Maintenance required", "an alert stands, or the final stage has begun"],
  check_function: ["Function check", "what healthy is, is being learned"],
  normal: ["Normal", "healthy as far as can be heard"],
};
export const STATE_ORDER = Object.keys(STATES);
export const stateWord = (state) => STATES[state]?.[0] ?? "Unknown";
export const knownState = (state) => (Object.hasOwn(STATES, state ?? "") ? state : "no_data");

const STAGES = {
  learning: "learning",
  healthy: "healthy",
  final: "final stage",
  end_of_life: "end of life",
};
export const stageWord = (stage) => STAGES[stage] ?? "";

export const PARTS = ["outer", "inner", "ball", "cage"];
export const PART_NAMES = { outer: "outer race", inner: "inner race", ball: "rolling element", cage: "cage" };
export const LINE_NAMES = { outer: "BPFO", inner: "BPFI", ball: "2×BSF", cage: "FTF" };

/** The damaged part; two where they cannot be told apart. */
export const faultWords = (fault) => (fault ? fault.split("|").map((part) => PART_NAMES[part] ?? part).join(" or ") : "");

const NOT_FINAL = "the bearing is not in the final stage of its life";
const NO_LIBRARY = "there is no library of simulated lives for this machine";
const EDV = {
  widened: "the interval is wider than usual, as the latest levels jumped",
  below_map: "the vibration is weaker than that of the smallest damage of the map",
  above_map:
    "the vibration is stronger than that of any damage of the map: the damage is larger than the map reaches, or the map does not fit this machine",
  no_map: "there is no RMS map for this channel, or it has a hole at this level",
  no_library: NO_LIBRARY,
  not_final_stage: NOT_FINAL,
  bad_block: "the quality of the latest block does not allow it",
  ambiguous: "several sizes of damage explain the vibration equally well",
  outside_conditions: "load or speed lie outside the map",
  outside_library: "load or speed lie outside the library",
  no_absolute_level: "the unit of the sensor is not known, so that the level of vibration means nothing",
};
const TT = {
  not_final_stage: NOT_FINAL,
  too_few_points: "there are too few values of V_eq yet to see a trend",
  no_crossing: "the fitted trend never reaches the threshold",
  concave: "the fitted trend flattens out before the threshold",
  crossing_in_past: "the fitted trend crosses the threshold in the past, though V_eq has not reached it",
  already_crossed: "the threshold has been reached",
  beyond_horizon: "the threshold lies beyond the horizon of the forecast",
  no_library: NO_LIBRARY,
  outside_library: "load or speed lie outside the library",
  cannot_tell: "the forecast cannot tell",
};
const NONE = "no block has said anything of it yet";
export const edvSentence = (status) => (status ? EDV[status] ?? status : NONE);
export const ttSentence = (status) => (status ? TT[status] ?? status : NONE);

const BLOCKS = {
  ok: "accepted",
  flat: "all samples are equal",
  stopped: "the machine stood still",
  clipped: "the sensor was at its limit",
  gap: "blocks are missing before it",
  clock: "its time cannot be right",
  late: "came after younger blocks",
  out_of_order: "came out of order",
  empty: "holds no samples",
  short: "shorter than a block should be",
  nan: "holds samples that are not finite",
  out_of_range: "samples beyond the sensor's range",
  wrong_rate: "sampled at another rate",
  wrong_shape: "another number of channels or columns",
  wrong_unit: "another unit than configured",
  unreadable: "could not be read",
  incomplete: "was never finished",
  refused: "a link, a device or a path outside the folder",
  reader_crashed: "the reader of its format gave up",
  duplicate: "had been taken before",
  changed: "its place was taken by another content",
};
export const FLAGS = ["flat", "stopped", "clipped", "gap", "clock", "late", "out_of_order"];
export const blockSentence = (status) => BLOCKS[status] ?? status;

export const FEATURES = {
  rms: "RMS",
  peak: "peak",
  kurtosis: "kurtosis",
  h_or: "H_or",
  v_eq: "V_eq",
  tt: "time left",
  tt_lower: "time left, lower end",
  tt_upper: "time left, upper end",
  v_eq_upper: "V_eq, upper end",
  p_threshold: "probability of reaching the threshold",
};
export const featureWord = (name) => FEATURES[name] ?? name.replaceAll("_", " ");

const DAEMON = {
  stopped: "The daemon was stopped",
  died: "The daemon has died",
  never_ran: "The daemon has never run",
  starting: "The daemon is starting",
};
export const daemonSentence = (status) => DAEMON[status] ?? "The daemon does not run";
