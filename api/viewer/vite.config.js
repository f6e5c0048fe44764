import { defineConfig } from "vite";

const service = process.env.VIEWER_SERVICE ?? "http://127.0.0.1:8080";

// The service takes writes only from its own origin; the page of the development server has another one.
const proxy = { "/v1": { target: service, changeOrigin: true, headers: { origin: service } } };

// What the service sends with the page.
const headers = {
  "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
};

export default defineConfig({
  // Relative paths: the page may be served below any path.
  base: "./",
  // The client is compiled from its sources; nothing has to be built before.
  resolve: { conditions: ["prosopon-source", "module", "browser", "development|production"] },
  ssr: { noExternal: ["@prosopon/client"], resolve: { conditions: ["prosopon-source", "module", "node", "development|production"] } },
  build: {
    target: "es2022",
    // The service's content security policy allows no inline data.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1200,
  },
  server: { proxy },
  preview: { proxy, headers },
});
