import type { App } from "./app.ts";

/** Time within which a new tab shows the report, ms. */
const TAB_MS = 10_000;

/** Opens the report of a job in a tab. A link cannot carry a token, so with one the page is fetched. */
export async function openReport(app: App, job: string): Promise<void> {
  // Before the request: later the browser would take it for a tab that nobody asked for.
  const tab = window.open("", "_blank");
  const done = await app.attempt("Open the report", async () => {
    if (!tab) throw new Error("The browser has blocked the new tab. Allow this page to open tabs.");
    await showReport(tab, await app.client.reportHtml(job));
    return true;
  });
  if (!done) tab?.close();
}

/**
 * Shows a report page in a tab, ready to print.
 *
 * The tab inherits the policy of this page, which forbids inline styles and `data:` images; both are in a report. Its styles are
 * therefore set by script, and its images become blobs.
 */
async function showReport(tab: Window, text: string): Promise<void> {
  // Taken out of the text, because the policy holds for a parsed page, too.
  const styles: string[] = [];
  const bare = text.replace(/<style[^>]*>(.*?)<\/style>/gis, (_, style: string) => {
    styles.push(style);
    return "";
  });
  const page = new DOMParser().parseFromString(bare, "text/html");
  for (const image of page.images) image.src = blobUrl(image.getAttribute("src") ?? "");
  const html = `<!doctype html>${page.documentElement.outerHTML}`;
  const url = URL.createObjectURL(new Blob([html], { type: "text/html" }));
  tab.location.href = url;
  for (const end = Date.now() + TAB_MS; tab.location.href !== url || tab.document.readyState !== "complete";) {
    if (Date.now() > end) throw new Error("The new tab does not show the report. Open it again.");
    await new Promise((done) => setTimeout(done, 20));
  }
  const { CSSStyleSheet: Sheet } = tab as Window & typeof globalThis;
  const sheets = styles.map((style) => {
    const sheet = new Sheet();
    sheet.replaceSync(style);
    return sheet;
  });
  tab.document.adoptedStyleSheets = sheets;
}

/** Address of a blob with the content of a base64 `data:` address; other addresses stay. */
function blobUrl(address: string): string {
  const [, type, base64] = /^data:([^;,]+);base64,(.*)$/s.exec(address) ?? [];
  if (type === undefined || base64 === undefined) return address;
  const bytes = Uint8Array.from(atob(base64), (char) => char.charCodeAt(0));
  return URL.createObjectURL(new Blob([bytes], { type }));
}
