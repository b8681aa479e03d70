/**
 * The feed of the server: the queue and all running prints, connected again with growing pauses.
 */

const FIRST_PAUSE = 500; // ms
const LONGEST_PAUSE = 30000; // ms

/**
 * Follow the feed until it is closed.
 *
 * @param {(message: any) => void} onMessage
 * @param {(isConnected: boolean) => void} onConnection is called when the connection begins or ends
 * @param {() => Promise<boolean>} checkSession returns whether the session still exists; if not, the feed ends
 * @returns {() => void} closes the feed
 */
export function followFeed(onMessage, onConnection, checkSession) {
  let pause = FIRST_PAUSE;
  let isClosed = false;
  let socket = /** @type {WebSocket | null} */ (null);
  let timer = 0;

  const connect = () => {
    timer = 0;
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/v1/feed`);
    socket.addEventListener("open", () => {
      pause = FIRST_PAUSE;
      onConnection(true);
    });
    socket.addEventListener("message", (event) => onMessage(JSON.parse(event.data)));
    socket.addEventListener("close", wait);
  };
  const wait = async () => {
    socket = null;
    if (isClosed) return;
    onConnection(false);
    if (!(await checkSession()) || isClosed) return;
    timer = setTimeout(connect, pause);
    pause = Math.min(2 * pause, LONGEST_PAUSE);
  };
  const connectNow = () => {
    if (!timer) return;
    clearTimeout(timer);
    connect();
  };
  addEventListener("online", connectNow);
  connect();
  return () => {
    isClosed = true;
    clearTimeout(timer);
    removeEventListener("online", connectNow);
    socket?.close();
  };
}
