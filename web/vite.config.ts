import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";

/** `npm run dev` serves the console on its own port and hands everything else to the server. */
const SERVER = "http://127.0.0.1:8000";

export default defineConfig({
  plugins: [react()],
  // Relative, so that the page also finds its files below a path that a proxy puts before it.
  base: "./",
  build: {
    target: "es2022",
    // Nothing is inlined as a data URL: the page's content security policy stays simple.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
  },
  server: {
    host: "127.0.0.1",
    proxy: {
      "/api": { target: SERVER, ws: true },
      "/scene": { target: SERVER, ws: true },
    },
  },
  test: { include: ["src/**/*.test.ts"], environment: "node" },
});
