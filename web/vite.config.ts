import { defineConfig } from "vite";

// The page lies beside the service that serves it, and from there in the wheel.
export default defineConfig({
  base: "./",
  build: {
    outDir: "../python/crowdfence/service/page",
    emptyOutDir: true,
    assetsInlineLimit: 0, // the content security policy allows no data: URLs but for pictures
    chunkSizeWarningLimit: 1500,
    target: "es2022",
  },
  server: { proxy: { "/api": { target: "http://127.0.0.1:8080", ws: true } } },
});
