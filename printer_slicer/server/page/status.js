/**
 * What the page knows: the queue, the running prints with their consoles, and the temperatures.
 */
import { followFeed } from "./feed.js";
import { RequestError, request } from "./requests.js";
import { addTemperatures } from "./temperature_history.js";

const MAX_LINES = 500;

/**
 * @typedef {Object} PrintStatus
 * @property {string} run
 * @property {any} status as `printer-slicer control status --json` gives it
 * @property {[number, string, string][]} console number, kind and text of each line
 */

/** What the page knows. */
export const known = {
  /** @type {any} the one who is signed in, null if nobody is */
  account: null,
  /** @type {any} null before the first message */
  queue: null,
  /** Why the server cannot read the queue, and what helps; empty if it can. */
  problem: "",
  /** @type {Map<string, PrintStatus>} by printer */
  prints: new Map(),
  isConnected: false,
  /** Time of the last message, s since 1970. */
  lastMessage: 0,
};

const listeners = new Set();
let closeFeed = () => {};
let isScheduled = false;

/** Call a function after each change. @param {() => void} listener */
export function onChange(listener) {
  listeners.add(listener);
}

/** Return whether the one who is signed in may do something. @param {string} scope @param {string} [printer] */
export function allows(scope, printer = "") {
  const { account } = known;
  return Boolean(account?.scopes.includes(scope)) && (!account.printer || !printer || account.printer === printer);
}

/** Ask who is signed in, and follow the feed if somebody is. */
export async function start() {
  if (!(await checkSession())) return;
  closeFeed();
  closeFeed = followFeed(receive, setConnected, checkSession);
}

/** Forget everything, because the session has ended: the page is loaded again, and asks to sign in. */
export function stop() {
  closeFeed();
  location.reload();
}

/** Return whether the session exists, or may exist because the server cannot be reached. */
async function checkSession() {
  try {
    known.account = await request("GET", "/v1/me");
  } catch (error) {
    if (error instanceof RequestError && error.status === 401) {
      if (known.account) stop();
      return false;
    }
    if (!known.account) throw error;
  }
  notify();
  return true;
}

/** Store whether the feed is connected. */
function setConnected(isConnected) {
  known.isConnected = isConnected;
  notify();
}

/** Store a message of the feed. */
function receive(message) {
  known.lastMessage = Date.now() / 1000;
  if (message.kind === "queue") receiveQueue(message.queue);
  else if (message.kind === "problem") known.problem = [message.detail, message.remedy].filter(Boolean).join(". ");
  else if (message.kind === "print") receivePrint(message);
  notify();
}

/** Store the queue; prints that have ended are forgotten. */
function receiveQueue(queue) {
  known.queue = queue;
  known.problem = "";
  const runs = new Set(queue.runs.map((run) => run.id));
  for (const [printer, print] of known.prints) {
    if (!runs.has(print.run)) known.prints.delete(printer);
  }
}

/** Store the status of a print, and add its new console lines. */
function receivePrint({ run, printer, status, console }) {
  const before = known.prints.get(printer);
  const lines = before?.run === run ? before.console : [];
  const last = lines.at(-1)?.[0] ?? 0;
  const all = [...lines, ...console.filter(([number]) => number > last)];
  known.prints.set(printer, { run, status, console: all.slice(-MAX_LINES) });
  addTemperatures(printer, status.temperatures ?? {}, known.lastMessage);
}

/** Call the listeners once before the next picture. */
function notify() {
  if (isScheduled) return;
  isScheduled = true;
  setTimeout(() => {
    isScheduled = false;
    for (const listener of listeners) listener();
  }, 0);
}
