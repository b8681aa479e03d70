/**
 * All printers.
 */
import { make, makeList, setShown } from "./elements.js";
import { updateExplanations } from "./explanations.js";
import { makePrinterCard } from "./printer_card.js";
import { known } from "./status.js";

/** Return the section with the printers. */
export function makePrintersSection() {
  const cards = make("ul", { class: "cards" });
  const empty = make("p", { hidden: true }, "There is no printer. Add one with printer-slicer queue add-printer.");
  const showPrinters = makeList(cards, (printer) => printer.name, makePrinterCard);
  return {
    title: "Printers",
    element: make("div", {}, cards, empty),
    show() {
      if (!known.queue) return;
      setShown(empty, known.queue.printers.length === 0);
      showPrinters(known.queue.printers);
      updateExplanations(() => showPrinters(known.queue.printers));
    },
  };
}
