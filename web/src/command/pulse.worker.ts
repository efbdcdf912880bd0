/** Ticks for the heartbeat. Browsers slow the timers of hidden pages down, those of workers hardly. */
const EVERY_MS = 2000;

setInterval(() => {
  postMessage("tick");
}, EVERY_MS);
