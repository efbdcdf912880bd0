import { afterEach, describe, expect, it, vi } from "vitest";
import { call, callAll } from "./call";

/** Answer everything, and note what was asked. */
function serve(answer: string): { readonly url: string; readonly method: string; readonly body: unknown }[] {
  const asked: { url: string; method: string; body: unknown }[] = [];
  vi.stubGlobal("fetch", (url: string, { method, body }: { method: string; body?: string }) => {
    asked.push({ url, method, body });
    return Promise.resolve(new Response(answer));
  });
  return asked;
}

describe("call", () => {
  afterEach(() => {
    vi.unstubAllGlobals();
  });

  it("fills the names of the route in, whatever they are", async () => {
    const asked = serve("{}");
    await call("POST /captures/{capture_id}/pictures", { path: { capture_id: "a/b?" }, body: { count: 4 } });
    expect(asked).toEqual([
      { url: "/api/v1/captures/a%2Fb%3F/pictures", method: "POST", body: JSON.stringify({ count: 4 }) },
    ]);
  });

  it("needs nothing where the route does not", async () => {
    const asked = serve("[]");
    expect(await call("GET /plans")).toEqual([]);
    expect(asked).toEqual([{ url: "/api/v1/plans", method: "GET", body: undefined }]);
  });

  it("asks what was asked for, and not what was not", async () => {
    const asked = serve("[]");
    await callAll("GET /artifacts", { query: { capture: "a b", cursor: null } });
    expect(asked.map(({ url }) => url)).toEqual(["/api/v1/artifacts?capture=a+b"]);
  });

  it("lets nothing pass that the server would refuse", () => {
    // Never called: the type checker reads it.
    const mistakes = () => {
      // @ts-expect-error -- there is no such route.
      void call("GET /captured");
      // @ts-expect-error -- the route has a name to fill in.
      void call("POST /captures/{capture_id}/pause");
      // @ts-expect-error -- a body has its fields.
      void call("POST /captures/{capture_id}/pictures", { path: { capture_id: "a" }, body: { pictures: 4 } });
      // @ts-expect-error -- this one has no pages.
      void callAll("GET /captures/{capture_id}", { path: { capture_id: "a" } });
    };
    expect(mistakes).toBeTypeOf("function");
  });
});
