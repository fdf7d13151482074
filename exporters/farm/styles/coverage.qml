<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Ground worked, a colour for each day; the categories are filled in by furrowmap. -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips|Temporal|Rendering">
 <temporal enabled="1" mode="1" startField="start" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="categorizedSymbol" attr="date" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories/>
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="120,198,121,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="35,60,35,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.4"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <layerOpacity>0.6</layerOpacity>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="format_date(&quot;date&quot;, 'yyyy-MM-dd')" isExpression="1" fontSize="9" fontSizeUnit="Point" fontFamily="Sans" textColor="40,40,40,255">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
   <placement placement="4" fitInPolygonOnly="1"/>
   <rendering scaleVisibility="1" scaleMin="1" scaleMax="2000" labelPerPart="1"/>
  </settings>
 </labeling>
 <mapTip enabled="1">&lt;b&gt;[% "name" %]&lt;/b&gt;, [% format_date("date", 'yyyy-MM-dd') %]&lt;br&gt;worked [% coalesce(format_number("area_m2", max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' ± ' || format_number(round(2 * "area_sigma_m2", 1 - floor(log10(2 * "area_sigma_m2"))), max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' m² (95 %)', format_number("area_m2", 1) || ' m²') %]</mapTip>
</qgis>
