import type { Routes } from "../protocol/rest.gen";
import { request, requestAll } from "./request";

/** Method and path as the server's own routes have it: `POST /captures/{capture_id}/pause`. */
type Route = keyof Routes;
type Answer<R extends Route> = Routes[R]["answer"];

/** The paths that know a method. */
export type PathOf<Method extends string> = Route extends infer R
  ? R extends `${Method} ${infer Path}`
    ? Path
    : never
  : never;

/** The routes that answer with a list. */
type ListRoute = { [R in Route]: Answer<R> extends readonly unknown[] ? R : never }[Route];

/** The names in the braces of a route's path. */
type Names<R extends string> = R extends `${string}{${infer Name}}${infer Rest}` ? Name | Names<Rest> : never;

type Asked<R extends Route> = { readonly timeoutMs?: number } & ([Names<R>] extends [never]
  ? unknown
  : { readonly path: Readonly<Record<Names<R>, string>> }) &
  (Routes[R]["body"] extends undefined ? unknown : { readonly body: Routes[R]["body"] }) &
  (Routes[R]["query"] extends undefined ? unknown : { readonly query?: Routes[R]["query"] });

/** What has to be told with a route; nothing, where all of it may be left out. */
type Telling<R extends Route> = object extends Asked<R> ? [asked?: Asked<R>] : [asked: Asked<R>];

/** What any route may be asked with. */
interface AnythingAsked {
  readonly timeoutMs?: number;
  readonly path?: Readonly<Record<string, string>>;
  readonly body?: unknown;
  readonly query?: Readonly<Record<string, string | number | null>>;
}

/**
 * Ask one of the server's routes, with what it wants and for what it answers.
 *
 * @throws RequestError when it is refused or not answered.
 */
export async function call<R extends Route>(route: R, ...[asked]: Telling<R>): Promise<Answer<R>> {
  const wish: AnythingAsked = asked ?? {};
  const [method, path] = addressOf(route, wish);
  return (await request(method, path, wish.body, wish.timeoutMs)) as Answer<R>;
}

/** Ask one of the server's routes for a list, page by page. @throws RequestError */
export async function callAll<R extends ListRoute>(route: R, ...[asked]: Telling<R>): Promise<Answer<R>> {
  const [, path] = addressOf(route, asked ?? {});
  return (await requestAll(path)) as Answer<R>;
}

type Method = Parameters<typeof request>[0];

function addressOf(route: Route, { path = {}, query = {} }: AnythingAsked): readonly [Method, string] {
  const [method, pattern = ""] = route.split(" ");
  const filled = pattern.replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(path[name] ?? ""));
  const wanted = Object.entries(query).flatMap(([key, value]) => (value === null ? [] : [[key, String(value)]]));
  return [method as Method, wanted.length === 0 ? filled : `${filled}?${new URLSearchParams(wanted).toString()}`];
}
