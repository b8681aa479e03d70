/**
 * Messages to the user, which screen readers read aloud: polite ones, and errors at once.
 */
import { make, setShown, setText } from "./elements.js";

const SHOWN_FOR = 8000; // ms
const MOST = 3;

const polite = make("div", { role: "status" });
const urgent = make("p", { class: "message error", role: "alert" });
const close = make("button", { type: "button", onclick: () => setShown(urgentRow, false) }, "Close");
const urgentRow = make("div", { class: "message-row", hidden: true }, urgent, close);

/** The place of the messages on the page. */
export const messages = make("div", { class: "messages" }, polite, urgentRow);

/** Tell the user something for some seconds. @param {string} text */
export function tell(text) {
  const message = make("p", { class: "message" }, text);
  polite.append(message);
  if (polite.children.length > MOST) polite.firstElementChild.remove();
  setTimeout(() => message.remove(), SHOWN_FOR);
}

/** Tell the user an error until it is closed. @param {unknown} error */
export function tellError(error) {
  setShown(urgentRow, true);
  setText(urgent, error instanceof Error ? error.message : String(error));
}
