import { Problem, Unreachable } from "./problem.ts";
import type { Transport } from "./transport.ts";

/** Options of an upload. */
export interface UploadOptions {
  /** Called with the bytes that were sent and the bytes of the file. */
  onProgress?: ((sent: number, total: number) => void) | undefined;
  /** Breaks the upload off. */
  signal?: AbortSignal | undefined;
}

/**
 * Sends a file as the body of a PUT and reads the JSON answer.
 *
 * Browsers report the progress of a request body only through `XMLHttpRequest`; elsewhere `fetch` sends the file and reports its
 * end.
 *
 * @throws Problem for an error answer, Unreachable without an answer, and the signal's reason when it is aborted.
 */
export async function upload<T>(transport: Transport, path: string, file: Blob, options: UploadOptions = {}): Promise<T> {
  if (typeof XMLHttpRequest !== "undefined") return uploadByXhr<T>(transport, path, file, options);
  const headers = { accept: "application/json", "content-type": "application/octet-stream" };
  const init: RequestInit & { headers: Record<string, string> } = { method: "PUT", headers, body: file };
  if (options.signal) init.signal = options.signal;
  const response = await transport.fetch(path, init);
  options.onProgress?.(file.size, file.size);
  return (await response.json()) as T;
}

function uploadByXhr<T>(transport: Transport, path: string, file: Blob, options: UploadOptions): Promise<T> {
  const { onProgress, signal } = options;
  return new Promise<T>((resolve, reject) => {
    if (signal?.aborted) return reject(signal.reason);
    const request = new XMLHttpRequest();
    request.open("PUT", transport.url(path));
    const headers = { accept: "application/json", "content-type": "application/octet-stream", ...transport.authorization() };
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    request.upload.onprogress = (event) => onProgress?.(event.loaded, file.size);
    request.onload = () => {
      if (request.status < 400) return resolve(JSON.parse(request.responseText) as T);
      const retryAfter = request.getResponseHeader("retry-after");
      reject(Problem.parse(request.responseText, request.status, request.statusText, retryAfter));
    };
    request.onerror = () => reject(new Unreachable(transport.url(path)));
    request.onabort = () => reject(signal?.reason);
    signal?.addEventListener("abort", () => request.abort(), { once: true });
    request.send(file);
  });
}
