import { BASE } from "./base";
import { CLIENT_HEADER, clientId } from "./tabId";
import { words } from "../text/words";

/** A request that was not carried out; the text is for the operator. */
export class RequestError extends Error {
  override readonly name = "RequestError";
  /** HTTP status, or null when no answer came. */
  readonly status: number | null;

  constructor(text: string, status: number | null, options?: ErrorOptions) {
    super(text, options);
    this.status = status;
  }
}

/** Work on the files of a whole capture may take this long, and longer only where it hangs. */
export const LONG_WORK_MS = 300_000;
const MOST_PAGES = 1000;
const ROOT = `${BASE}/api/v1`;

/**
 * Send a request to the server and return its JSON answer (undefined when the answer is empty).
 *
 * @throws RequestError when no answer comes within `timeoutMs` or the answer is a refusal.
 */
export async function request(
  method: "DELETE" | "GET" | "POST" | "PUT",
  path: string,
  body?: unknown,
  timeoutMs = 10_000,
): Promise<unknown> {
  const text = await textOf(await answer(method, path, body, timeoutMs));
  return text === "" ? undefined : readJson(text);
}

/**
 * Ask for a list page by page, as the header `Link` tells, and return all of it.
 *
 * @throws RequestError as `request` does, and when pages never end.
 */
export async function requestAll(path: string): Promise<readonly unknown[]> {
  const items: unknown[] = [];
  let next: string | null = path;
  for (let pages = 0; next !== null; pages++) {
    if (pages === MOST_PAGES) throw new RequestError(words.request.endless, null);
    const response: Response = await answer("GET", next, undefined, 10_000);
    items.push(...(readJson(await textOf(response)) as readonly unknown[]));
    next = nextPage(path, response.headers.get("Link"));
  }
  return items;
}

/** The path of the page that a header `Link` (RFC 8288) names next; null on the last page. */
export function nextPage(path: string, link: string | null): string | null {
  const target = /<([^>]*)>\s*;\s*rel="?next"?/.exec(link ?? "")?.[1];
  if (target === undefined) return null;
  // A proxy may serve us below a path that the target does not have: only what it asks for counts.
  return `${path.split("?")[0] ?? path}?${target.split("?")[1] ?? ""}`;
}

/** Ask for a text. @throws RequestError as `request` does. */
export async function requestText(path: string, timeoutMs = 10_000): Promise<string> {
  return textOf(await answer("GET", path, undefined, timeoutMs));
}

async function textOf(response: Response): Promise<string> {
  const text = await response.text();
  if (!response.ok) throw new RequestError(reason(response, text), response.status);
  return text;
}

async function answer(
  method: string,
  path: string,
  body: unknown,
  timeoutMs: number,
): Promise<Response> {
  try {
    return await fetch(ROOT + path, {
      method,
      credentials: "same-origin",
      cache: "no-store",
      // A stop pressed while the page is closing still leaves the browser.
      keepalive: method === "POST",
      signal: AbortSignal.timeout(timeoutMs),
      headers: {
        [CLIENT_HEADER]: clientId,
        ...(body === undefined ? {} : { "Content-Type": "application/json" }),
      },
      ...(body === undefined ? {} : { body: JSON.stringify(body) }),
    });
  } catch (error) {
    const late = error instanceof DOMException && error.name === "TimeoutError";
    const text = late ? words.request.late(timeoutMs / 1000) : words.request.unreachable;
    throw new RequestError(text, null, { cause: error });
  }
}

function readJson(text: string): unknown {
  try {
    return JSON.parse(text) as unknown;
  } catch (error) {
    throw new RequestError(words.request.notJson, null, { cause: error });
  }
}

/** The sentence of a problem document (RFC 9457), else that there is none. */
function reason(response: Response, text: string): string {
  if (response.status === 401) return words.request.signedOut;
  const type = response.headers.get("Content-Type") ?? "";
  if (!type.includes("json")) return words.request.refused(response.status);
  try {
    return problemText(JSON.parse(text)) ?? words.request.refused(response.status);
  } catch {
    return words.request.refused(response.status);
  }
}

/**
 * Return detail and field errors of a problem document, or null where it has none.
 *
 * Its title is HTTP's own phrase, which tells an operator nothing.
 */
export function problemText(problem: unknown): string | null {
  if (typeof problem !== "object" || problem === null) return null;
  const { detail, errors } = problem as Record<"detail" | "errors", unknown>;
  const parts = typeof detail === "string" && detail !== "" ? [detail] : [];
  if (Array.isArray(errors)) {
    for (const error of errors as unknown[]) {
      if (typeof error === "string") parts.push(error);
      else if (typeof error === "object" && error !== null) parts.push(fieldText(error));
    }
  }
  return parts.length === 0 ? null : parts.join(" — ");
}

function fieldText(error: object): string {
  const { loc, msg, field, detail } = error as Record<string, unknown>;
  const place: unknown = Array.isArray(loc) ? loc.at(-1) : field;
  const text = typeof msg === "string" ? msg : typeof detail === "string" ? detail : "";
  return typeof place === "string" || typeof place === "number" ? `${place}: ${text}` : text;
}
