/**
 * Write times, sizes and figures for people.
 */

/** Return a time of day, with the date if it is another day. @param {number} seconds since 1970 */
export function formatTime(seconds) {
  const time = new Date(seconds * 1000);
  const clock = time.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  const isToday = time.toDateString() === new Date().toDateString();
  return isToday ? clock : `${time.toLocaleDateString([], { day: "numeric", month: "short" })} ${clock}`;
}

/** Return a duration such as "2 h 05 min". @param {number} seconds */
export function formatDuration(seconds) {
  const minutes = Math.round(seconds / 60);
  if (minutes < 1) return `${Math.round(seconds)} s`;
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

/** Return a size such as "1.2 MB". @param {number} bytes */
export function formatSize(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Return what is known of a file as text. @param {any} facts null if it was not read yet */
export function formatFacts(facts) {
  if (!facts) return "not read yet";
  if (facts.problem) return facts.problem;
  const parts = [];
  if (facts.seconds) parts.push(formatDuration(facts.seconds));
  if (facts.layers) parts.push(facts.layers === 1 ? "1 layer" : `${facts.layers} layers`);
  if (facts.filament) parts.push(`${(facts.filament / 1000).toFixed(1)} m filament`);
  return [...parts, facts.material, facts.printer].filter(Boolean).join(" · ");
}
