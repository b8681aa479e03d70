/**
 * Requests to the server. The session is in a cookie that scripts cannot read.
 */

const OWN_HEADER = { "x-printer-slicer": "1" };

/** The server cannot be reached, or has refused a request; the message is for people. */
export class RequestError extends Error {
  /**
   * @param {number} status of HTTP; 0 if the server cannot be reached
   * @param {string} message
   */
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/**
 * Send a request, and return what the answer holds.
 *
 * @param {string} method
 * @param {string} path
 * @param {object} [body] is sent as JSON
 * @returns {Promise<any>} null if the answer is empty
 * @throws {RequestError}
 */
export async function request(method, path, body) {
  const headers = body ? { ...OWN_HEADER, "content-type": "application/json" } : OWN_HEADER;
  let answer;
  try {
    answer = await fetch(path, { method, headers, body: body && JSON.stringify(body) });
  } catch {
    throw new RequestError(0, "The server cannot be reached");
  }
  return readAnswer(answer.status, await answer.text());
}

/**
 * Send a form with a file.
 *
 * @param {string} path
 * @param {Record<string, string | File>} fields the file comes last
 * @param {(share: number) => void} onProgress gets the share that was sent, 0 to 1
 * @returns {Promise<any>} the answer
 * @throws {RequestError}
 */
export function uploadFile(path, fields, onProgress) {
  const form = new FormData();
  for (const [name, value] of Object.entries(fields)) form.append(name, value);
  const upload = new XMLHttpRequest();
  upload.open("POST", path);
  for (const [name, value] of Object.entries(OWN_HEADER)) upload.setRequestHeader(name, value);
  upload.upload.addEventListener("progress", (event) => onProgress(event.loaded / (event.total || 1)));
  return new Promise((resolve, reject) => {
    upload.addEventListener("load", () => {
      try {
        resolve(readAnswer(upload.status, upload.responseText));
      } catch (error) {
        reject(error);
      }
    });
    upload.addEventListener("error", () => reject(new RequestError(0, "The upload was interrupted")));
    upload.send(form);
  });
}

/** Return the content of an answer, or throw what is wrong. */
function readAnswer(status, text) {
  let content = null;
  try {
    content = text ? JSON.parse(text) : null;
  } catch {
    throw new RequestError(status, "The answer of the server cannot be read");
  }
  if (status < 400) return content;
  const { detail = `The server answered with status ${status}`, remedy = "" } = content ?? {};
  const first = detail.charAt(0).toUpperCase() + detail.slice(1);
  const isForPage = remedy && !remedy.includes("printer-slicer "); // others name commands
  throw new RequestError(status, isForPage ? `${first}. ${remedy}.` : `${first}.`);
}
