/**
 * The page: sections behind links, the state of the connection, messages, and the emergency stops.
 */
import { announceStates } from "./announcements.js";
import { applyAppearance } from "./appearance.js";
import { make, setShown, setText } from "./elements.js";
import { makeEmergencyStops } from "./emergency_stop.js";
import { makeFilesSection } from "./files_section.js";
import { formatTime } from "./formats.js";
import { makeHistorySection } from "./history_section.js";
import { messages, tellError } from "./messages.js";
import { makeNewJobSection } from "./new_job_section.js";
import { makePrintersSection } from "./printers_section.js";
import { makeQueueSection } from "./queue_section.js";
import { makeSettingsSection } from "./settings_section.js";
import { makeSignIn } from "./sign_in.js";
import { known, onChange, start } from "./status.js";

const RETRY = 3000; // ms

/** Make the page, and keep it up to date. */
function openPage() {
  applyAppearance();
  const sections = [makePrintersSection(), makeNewJobSection(), makeQueueSection(), makeFilesSection(), makeHistorySection(), makeSettingsSection()];
  const links = sections.map((section) => make("a", { href: `#${section.title.toLowerCase().replace(" ", "-")}` }, section.title));
  const navigation = make("nav", { "aria-label": "Sections" }, ...links);
  const connection = make("p", { class: "connection", role: "status" });
  const heading = make("h2", { tabIndex: -1 });
  const place = make("div", {});
  const main = make("main", {}, heading, place);
  const signIn = make("main", { hidden: true }, makeSignIn());
  const stops = makeEmergencyStops();
  document.body.append(make("header", {}, make("h1", {}, "printer_slicer"), navigation), connection, messages, main, signIn, stops.element);

  const findCurrent = () => Math.max(0, links.findIndex((link) => link.hash === location.hash));
  const show = () => {
    const isSignedIn = Boolean(known.account);
    for (const element of [navigation, main]) setShown(element, isSignedIn);
    setShown(signIn, !isSignedIn);
    showConnection(connection);
    stops.show();
    if (isSignedIn) sections[findCurrent()].show();
  };
  const turn = () => {
    const section = sections[findCurrent()];
    links.forEach((link, number) => link.setAttribute("aria-current", number === findCurrent() ? "page" : "false"));
    setText(heading, section.title);
    document.title = `${section.title} · printer_slicer`;
    place.replaceChildren(section.element);
    show();
  };
  addEventListener("hashchange", () => {
    turn();
    heading.focus();
  });
  onChange(show);
  announceStates();
  turn();
  startUntilAnswered();
}

/** Say whether the figures are new, and why not. */
function showConnection(element) {
  const isOld = Boolean(known.account) && !known.isConnected && known.lastMessage > 0;
  const text = isOld ? `Not connected. Figures are from ${formatTime(known.lastMessage)}.` : known.account ? known.problem : "";
  document.body.classList.toggle("old", isOld);
  setShown(element, text !== "");
  setText(element, text);
}

/** Begin; if the server cannot be reached, again and again. */
function startUntilAnswered() {
  start().catch((error) => {
    tellError(error);
    setTimeout(startUntilAnswered, RETRY);
  });
}

openPage();
